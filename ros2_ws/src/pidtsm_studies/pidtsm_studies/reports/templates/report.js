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
  const update = {};
  for (const axis of axes) {
    update[`${axis}.type`] = logarithmic ? "log" : "linear";
    update[`${axis}.autorange`] = true;
  }
  div.signed ??= div.data.map((trace) => trace.y);
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

// The arm. Joint angles add up from the horizontal; y points up, but down in the drawing.

function animate({ links, rate, box, runs }) {
  const trailTime = 2.0; // s
  const slider = element("arm-time");
  const play = element("arm-play");
  const caseChoice = element("arm-case");
  const lawChoice = element("arm-law");
  let run;
  let playing = false;
  let last = 0;

  element("arm-drawing").setAttribute("viewBox", box.join(" "));
  Object.entries({ x1: box[0], x2: box[0] + box[2], y1: 0, y2: 0 }).forEach(([k, v]) => element("arm-ground").setAttribute(k, v));
  element("arm-joints").innerHTML = '<circle r="0.035"/>'.repeat(links.length + 1);

  function at(values, sample) {
    return links.map((_, joint) => values[sample * links.length + joint]);
  }

  /** Base and end of every link. */
  function points(angles) {
    let x = 0, y = 0, angle = 0;
    return [[0, 0], ...links.map((length, joint) => {
      angle += angles[joint];
      x += length * Math.cos(angle);
      y += length * Math.sin(angle);
      return [x, -y];
    })];
  }

  function position(sample) {
    const error = at(run.error, sample);
    return points(at(run.reference, sample).map((angle, joint) => angle + error[joint]));
  }

  function line(id, corners) {
    element(id).setAttribute("points", corners.map((corner) => corner.map((x) => x.toFixed(5)).join(",")).join(" "));
  }

  function show() {
    const time = Number(slider.value);
    const sample = Math.min(Math.round(time * rate), run.samples - 1);
    const arm = position(sample);
    const reference = points(at(run.reference, sample));
    line("arm-links", arm);
    line("arm-reference", reference);
    [...element("arm-joints").children].forEach((circle, i) => {
      circle.setAttribute("cx", arm[i][0]);
      circle.setAttribute("cy", arm[i][1]);
    });
    const begin = Math.max(0, sample - trailTime * rate);
    line("arm-trail", Array.from({ length: sample - begin + 1 }, (_, k) => position(begin + k).at(-1)));
    element("arm-clock").value = `${time.toFixed(2)} s`;
    at(run.error, sample).forEach((error, joint) => (element(`arm-error-${joint}`).value = `${error.toExponential(2)} rad`));
    const [tip, target] = [arm.at(-1), reference.at(-1)];
    const distance = Math.hypot(tip[0] - target[0], tip[1] - target[1]);
    element("arm-distance").value = `${(1000 * distance).toPrecision(3)} mm`;
    slider.setAttribute("aria-valuetext", `${time.toFixed(2)} seconds`);
    const happened = element("arm-event");
    happened.hidden = run.event === null;
    if (run.event !== null) {
      happened.textContent = `${time < run.event ? "Before" : "After"} the event at ${run.event} s.`;
    }
  }

  function choose() {
    for (const option of lawChoice.options) option.disabled = !(`${caseChoice.value} ${option.value}` in runs);
    if (lawChoice.selectedOptions[0].disabled) lawChoice.value = [...lawChoice.options].find((o) => !o.disabled).value;
    const packed = runs[`${caseChoice.value} ${lawChoice.value}`];
    run = { ...packed, reference: unpack(packed.reference), error: unpack(packed.error) };
    run.samples = run.error.length / links.length;
    slider.max = (run.samples - 1) / rate;
    slider.step = 1 / rate;
    for (const id of ["arm-links", "arm-trail"]) element(id).style.stroke = run.colour;
    element("arm-errors").replaceChildren(...run.joints.map((joint, index) => {
      const entry = document.createElement("div");
      entry.innerHTML = `<dt></dt><dd><output id="arm-error-${index}" for="arm-time"></output></dd>`;
      entry.firstChild.textContent = `error of ${joint}`;
      return entry;
    }));
    show();
  }

  let clock = 0; // s; the slider only has steps
  function frame(now) {
    if (!playing) return;
    clock += Math.min(now - last, 100) / 1000 * Number(element("arm-speed").value);
    last = now;
    slider.value = clock;
    show();
    if (clock >= Number(slider.max)) return setPlaying(false);
    requestAnimationFrame(frame);
  }

  function setPlaying(value) {
    playing = value;
    play.textContent = playing ? "Pause" : "Play";
    if (!playing) return;
    clock = Number(slider.value) < Number(slider.max) ? Number(slider.value) : 0;
    last = performance.now();
    requestAnimationFrame(frame);
  }

  play.addEventListener("click", () => setPlaying(!playing));
  slider.addEventListener("input", () => { clock = Number(slider.value); show(); });
  caseChoice.addEventListener("change", choose);
  lawChoice.addEventListener("change", choose);
  choose();
}

if (data.arm) animate(data.arm);
