"use strict";

const data = JSON.parse(document.getElementById("data").textContent);
const element = (id) => document.getElementById(id);

/** Numbers of a packed array: little-endian floats in base64. */
function unpack(packed) {
  return new Float32Array(Uint8Array.from(atob(packed.bdata), (c) => c.charCodeAt(0)).buffer);
}

// Plots. Each is drawn when it is near the visible area; the controls also apply to plots that are drawn later.

const drawn = new Set();

function shown(law) {
  const box = document.querySelector(`input[name="law"][value="${CSS.escape(law)}"]`);
  return !box || box.checked;
}

function draw(div) {
  if (drawn.has(div.id)) return;
  drawn.add(div.id);
  const { data: traces, layout } = data.figures[div.id];
  for (const trace of traces) {
    trace.x = unpack(trace.x);
    trace.y = unpack(trace.y);
    if (trace.meta) trace.visible = shown(trace.meta);
  }
  Plotly.newPlot(div, traces, layout, {
    responsive: true,
    displaylogo: false,
    showSendToCloud: false, // nothing leaves this page
    displayModeBar: window.innerWidth < 600 ? false : "hover", // where it would hide the legend
  });
  div.on("plotly_legendclick", (event) => {
    const law = event.data[event.curveNumber].meta;
    const box = document.querySelector(`input[name="law"][value="${CSS.escape(law || "")}"]`);
    if (box) box.click();
    return !box;
  });
  const log = document.querySelector(`input[data-log="${CSS.escape(div.id)}"]`);
  if (log && log.checked) scale(div, true);
}

/** Show e on a linear axis, or |e| on a logarithmic one. */
function scale(div, logarithmic) {
  const axes = Object.keys(div.layout).filter((key) => key.startsWith("yaxis"));
  div.signed ??= div.data.map((trace) => trace.y);
  div.names ??= axes.map((axis) => div.layout[axis].title.text);
  const update = {};
  axes.forEach((axis, row) => {
    update[`${axis}.type`] = logarithmic ? "log" : "linear";
    update[`${axis}.autorange`] = true;
    update[`${axis}.title.text`] = (logarithmic ? div.layout.meta.magnitudes : div.names)[row];
  });
  Plotly.update(div, { y: logarithmic ? div.signed.map((y) => y.map(Math.abs)) : div.signed }, update);
}

const plots = [...document.querySelectorAll(".plot")];
const near = new IntersectionObserver(
  (entries) => entries.filter((entry) => entry.isIntersecting).forEach((entry) => draw(entry.target)),
  { rootMargin: "400px" },
);
plots.forEach((div) => near.observe(div));
window.addEventListener("beforeprint", () => plots.forEach(draw));

document.querySelectorAll('input[name="law"]').forEach((box) =>
  box.addEventListener("change", () => {
    for (const div of plots.filter((plot) => drawn.has(plot.id))) {
      const its = div.data.flatMap((trace, index) => (trace.meta === box.value ? [index] : []));
      if (its.length) Plotly.restyle(div, { visible: box.checked ? true : "legendonly" }, its);
    }
  }),
);
document.querySelectorAll("input[data-log]").forEach((box) =>
  box.addEventListener("change", () => drawn.has(box.dataset.log) && scale(element(box.dataset.log), box.checked)),
);
