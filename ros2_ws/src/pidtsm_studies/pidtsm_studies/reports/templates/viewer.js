// The viewer: arm, curves and marks share one time, one chosen joint, and the runs that are shown.

function startViewer(viewer) {
  const { rate, joints, units } = viewer;
  const several = new Set(Object.values(viewer.runs).map((run) => run.key)).size > 1;
  const state = { time: 0, joint: viewer.joint, playing: false, range: null };
  const figures = [...document.querySelectorAll(".time[data-plot]")];
  const slider = element("time");
  const boxes = [...document.querySelectorAll('input[name="run"]')];

  const runs = Object.entries(viewer.runs).map(([name, run]) => {
    const [error, effort] = [unpack(run.error), unpack(run.effort)];
    const at = (values) => (joint, sample) => values[Math.max(0, Math.min(sample, values.length / joints.length - 1)) * joints.length + joint];
    return {
      ...run,
      name,
      error: at(error),
      effort: at(effort),
      share: (joint, sample) => at(effort)(joint, sample) / run.largest[joint],
      arm: viewer.arm?.runs[name] ? unpackArm(viewer.arm.runs[name], (other) => runs.find((each) => each.name === other).arm.numbers.reference) : null,
    };
  });
  const curves = Object.fromEntries(
    Object.entries(viewer.cases).map(([name, found]) => [name, { ...found, time: unpack(found.time), unpacked: new Map() }]),
  );

  const caseName = () => (element("case") ? element("case").value : Object.keys(viewer.cases)[0]);
  const ofCase = () => runs.filter((run) => run.case === caseName());
  const shown = () => ofCase().filter((run) => boxes.every((box) => box.value !== run.key || box.checked));
  const longest = () => Math.max(...ofCase().map((run) => run.duration));
  const start = () => Math.min(...ofCase().map((run) => run.start));
  const sample = () => Math.round(state.time * rate);

  /** Values of a plot of a run, one array per joint of the plot, in the unit of the plot; null where there is none. */
  function rowsOf(found, run, plot) {
    const key = `${run.key} ${plot.id}`;
    if (!found.unpacked.has(key)) {
      const values = unpack(found.values[run.key][plot.id]);
      const length = found.time.length;
      const row = (j) => Array.from(values.subarray(j * length, (j + 1) * length), (x) => (Number.isNaN(x) ? null : x * plot.factor));
      found.unpacked.set(key, plot.joints.map((_, j) => row(j)));
    }
    return found.unpacked.get(key);
  }

  /** Lines of a plot: of one run a line per joint; of several runs a line per run, of the chosen joint or of all. */
  function linesOf(found, plot) {
    return shown().filter((run) => found.values[run.key][plot.id]).flatMap((run) =>
      rowsOf(found, run, plot).flatMap((values, row) => {
        const joint = plot.joints[row];
        const chosen = state.joint === null || state.joint === joint;
        if (several && !chosen) return [];
        return [{ run, joint, values, faded: !chosen, looks: several ? run : viewer.joint_looks[joint] }];
      }),
    );
  }

  /** Marks of events: a line at its time with its symbol above, and a shade while it lasts. */
  function drawEvents(plot) {
    const { ctx, bbox } = plot;
    const ratio = devicePixelRatio * enlarged();
    const events = shown().flatMap((run) => run.events).sort((a, b) => a.time - b.time);
    const place = (time) => plot.valToPos(time, "x", true);
    let free = bbox.left; // from here on there is room for a symbol
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    for (const event of events) {
      ctx.strokeStyle = ctx.fillStyle = look(event.kind === "fault" ? "--bad" : "--mark");
      if (event.until !== null) {
        ctx.globalAlpha = 0.12;
        ctx.fillRect(place(event.time), bbox.top, Math.max(2, place(event.until) - place(event.time)), bbox.height);
        ctx.globalAlpha = 1;
      }
      ctx.setLineDash([2 * ratio, 3 * ratio]);
      ctx.beginPath();
      ctx.moveTo(place(event.time), bbox.top);
      ctx.lineTo(place(event.time), bbox.top + bbox.height);
      ctx.stroke();
      ctx.font = `${11 * ratio}px system-ui`;
      if (place(event.time) < free) continue;
      ctx.fillText(event.symbol, place(event.time) + 3 * ratio, bbox.top + 11 * ratio);
      free = place(event.time) + 14 * ratio;
    }
    ctx.restore();
  }

  /** The lines of each plot; plots without lines are hidden before others are drawn, which then have their room. */
  function drawFigures() {
    const found = curves[caseName()];
    const plots = figures.map((figure) => found.plots.find((each) => each.id === figure.dataset.plot));
    const lines = plots.map((plot) => (plot ? linesOf(found, plot) : []));
    figures.forEach((figure, i) => { figure.hidden = !lines[i].length; });
    figures.forEach((figure, i) => { if (lines[i].length) drawFigure(figure, found, lines[i]); });
  }

  function drawFigure(figure, found, lines) {
    const box = figure.querySelector(".plot");
    const below = [...figure.parentElement.querySelectorAll(".time:not([hidden])")].at(-1) !== figure;
    const log = figure.querySelector("[data-log]")?.checked;
    const values = lines.map((each) => (log ? each.values.map((x) => (x === null || x === 0 ? null : Math.abs(x))) : each.values));
    const drawn = plotInto(
      box,
      {
        scales: { x: { time: false, range: () => state.range || [start(), start() + longest()] }, y: log ? { distr: 3 } : { range: roomy } },
        axes: axes(below && !figure.closest("details") ? "" : "time in s", ""),
        series: [{}, ...lines.map((each) => line(each.looks, each.faded))],
        cursor: { y: false, points: { size: 5 }, drag: { x: true, y: false, setScale: false } },
        hooks: {
          draw: [drawEvents],
          setCursor: [(u) => u.cursor.left >= 0 && u.cursor.event && !state.playing && setTime(u.posToVal(u.cursor.left, "x") - start())],
          setSelect: [(u) => zoom(u.posToVal(u.select.left, "x"), u.posToVal(u.select.left + u.select.width, "x"), u)],
        },
      },
      [found.time, ...values],
    );
    if (!drawn) return;
    box.lines = lines;
    const now = document.createElement("div");
    now.className = "now";
    drawn.over.append(now);
    drawn.over.addEventListener("dblclick", () => zoom(null));
    drawn.over.addEventListener("click", () => chooseNearest(drawn, lines, values));
    moveNow(box);
  }

  function moveNow(box) {
    const at = box.plot?.valToPos(start() + state.time, "x");
    const now = box.plot?.over.querySelector(".now");
    if (now) {
      now.style.transform = `translateX(${at}px)`;
      now.hidden = at < 0 || at > box.plot.over.clientWidth;
    }
  }

  /** The joint of the line that is nearest to the pointer. */
  function chooseNearest(plot, lines, values) {
    const { idx, top } = plot.cursor;
    if (idx === null || idx === undefined) return;
    const far = values.map((each) => (each[idx] === null ? Infinity : Math.abs(plot.valToPos(each[idx], "y") - top)));
    const nearest = far.indexOf(Math.min(...far));
    if (far[nearest] < 30) chooseJoint(lines[nearest].joint);
  }

  function zoom(from, to, plot) {
    if (plot) {
      if (plot.select.width < 4) return;
      plot.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
    }
    state.range = from === null ? null : [Math.max(start(), from), Math.min(start() + longest(), to)];
    drawFigures();
  }

  function zoomBy(factor) {
    const [from, to] = state.range || [start(), start() + longest()];
    const half = (factor * (to - from)) / 2;
    const middle = start() + state.time;
    if (2 * half >= longest()) return zoom(null);
    const begin = Math.min(Math.max(start(), middle - half), start() + longest() - 2 * half);
    zoom(begin, begin + 2 * half);
  }

  function chooseJoint(joint) {
    state.joint = joint;
    document.querySelectorAll("#joints button").forEach((button) => button.setAttribute("aria-pressed", String(button.dataset.joint === (joint === null ? "" : String(joint)))));
    document.querySelectorAll(".matrix thead [data-joint]").forEach((head) => head.setAttribute("aria-current", String(Number(head.dataset.joint) === joint)));
    redrawAll();
  }

  /** What is shown beside the arm: of one run every joint, of several runs each with the chosen or its worst joint. */
  function readout() {
    const k = sample();
    const guided = several && runs.every((run) => run.arm?.hasReference);
    const worst = (run) => joints.map((_, j) => j).reduce((a, b) => (Math.abs(run.error(b, k)) > Math.abs(run.error(a, k)) ? b : a));
    const lines = several
      ? shown().map((run) => [run, state.joint ?? worst(run), run.label])
      : shown().flatMap((run) => joints.map((joint, j) => [run, j, joint]));
    const cells = lines.map(([run, j, name]) => [name, ...(several ? [joints[j]] : []), quantity(run.error(j, k), units[j][0]), quantity(run.effort(j, k), units[j][1]), ...(guided ? [quantity(run.arm.distance(Math.min(k, run.arm.samples - 1)), "m")] : [])]);
    const heads = several ? ["run", "joint", ...viewer.heads, ...(guided ? ["tool from its reference"] : [])] : ["joint", ...viewer.heads];
    const across = !several && joints.length > 3;
    fill(element("readout"), heads, cells, across);
    if (!several && shown()[0]?.arm?.hasReference) {
      const run = shown()[0];
      element("readout").caption.textContent = `Values at the cursor; the tool is ${quantity(run.arm.distance(Math.min(k, run.arm.samples - 1)), "m")} from its reference`;
    }
  }

  /** A small table; of one run the joints stand beside each other. */
  function fill(table, heads, rows, across) {
    const grid = across ? heads.map((head, i) => [head, ...rows.map((row) => row[i])]) : [heads, ...rows];
    const tag = (name, text, scope) => {
      const cell = document.createElement(name);
      cell.textContent = text;
      if (scope) cell.scope = scope;
      return cell;
    };
    const lines = grid.map((row, i) => {
      const line = document.createElement("tr");
      line.append(...row.map((text, j) => (i === 0 ? tag("th", text, "col") : j === 0 ? tag("th", text, "row") : tag("td", text))));
      return line;
    });
    table.tHead.replaceChildren(lines[0]);
    table.tBodies[0].replaceChildren(...lines.slice(1));
  }

  let drawArm = null; // The arm of an identification is drawn whatever torques are shown.
  function show() {
    if (element("arm")) {
      drawArm ??= armDrawer(element("arm"), viewer.arm, rate);
      const arms = shown().filter((run) => run.arm);
      drawArm(arms.length ? arms : ofCase().filter((run) => run.arm).slice(0, 1), state.time, state.joint);
    }
    figures.forEach((figure) => moveNow(figure.querySelector(".plot")));
    readout();
    element("clock").value = `${(start() + state.time).toFixed(2)} s`;
    slider.value = state.time;
    slider.setAttribute("aria-valuetext", `${(start() + state.time).toFixed(2)} seconds`);
  }

  function setTime(time) {
    state.time = Math.max(0, Math.min(time, longest()));
    show();
  }

  /** Each mark at its time with its words beside it, where a lane has room, important ones first; else its symbol. */
  function placeMarks(box, buttons) {
    const importance = ["fault", "push", "payload", "contact", "limit", "mode", "learnt"];
    const lanes = [[], [], []]; // taken parts, px
    const [whole, half] = [box.clientWidth, 0.65 * parseFloat(getComputedStyle(document.documentElement).fontSize)];
    const placed = buttons.map((button) => ({ button, at: (whole * button.time) / longest(), width: button.offsetWidth + half }));
    const laneFor = (begin, width) => lanes.findIndex((taken) => taken.every(([from, to]) => begin >= to || begin + width <= from));
    placed.sort((a, b) => importance.indexOf(a.button.className) - importance.indexOf(b.button.className) || a.at - b.at);
    for (const { button, at, width } of placed) {
      const right = at - half + width <= whole + 2 * half ? laneFor(at - half, width) : -1;
      const left = at + half - width >= -half ? laneFor(at + half - width, width) : -1;
      const words = right >= 0 || left >= 0;
      let begin = right >= 0 || !words ? at - half : at + half - width;
      let lane = right >= 0 ? right : left;
      while (lane < 0) {
        lane = laneFor(begin, 2 * half);
        if (lane < 0) begin += half; // Marks that would cover each other stand beside each other.
      }
      button.lastChild.hidden = !words;
      button.classList.toggle("turned", words && right < 0);
      button.style.left = `${begin}px`;
      button.style.bottom = `${1.25 * lane}rem`;
      lanes[lane].push([begin, begin + (words ? width : 2 * half)]);
    }
    const used = Math.max(1, lanes.findLastIndex((taken) => taken.length) + 1);
    box.parentElement.style.setProperty("--lanes", used);
  }

  /** The scene is as high as the window has room for, between what is above it and the time line. */
  function fitScene() {
    const scene = document.querySelector(".scene");
    const above = scene.getBoundingClientRect().top + scrollY;
    scene.style.setProperty("--around", `${Math.round(above + document.querySelector(".transport").offsetHeight + 16)}px`);
  }

  function marks() {
    const together = new Map(); // what happens in several runs at the same time has one mark
    for (const run of shown()) {
      for (const event of run.events) {
        const key = `${event.kind} ${Math.round((50 * event.time) / longest())} ${event.label}`;
        together.set(key, { event, runs: [...(together.get(key)?.runs ?? []), run.label] });
      }
    }
    const buttons = [...together.values()].map(({ event, runs: names }) => {
      const button = document.createElement("button");
      button.type = "button";
      button.className = event.kind;
      button.innerHTML = "<span></span> <span></span>";
      const words = event.kind === "learnt" && shown().length > 1 ? "" : event.label; // of which run, the title says
      [button.firstChild.textContent, button.lastChild.textContent] = [event.symbol, words];
      button.time = event.time - start();
      const who = names.length < shown().length ? `${names.join(", ")}: ` : "";
      const text = `${written(event.time)}\u202fs: ${who}${event.text}`;
      button.title = text;
      button.setAttribute("aria-label", text);
      button.addEventListener("click", () => {
        setTime(event.time - start());
        element("event").textContent = text;
        if (event.joint !== null) chooseJoint(event.joint);
      });
      return button;
    });
    buttons.sort((a, b) => a.time - b.time);
    element("marks").replaceChildren(...buttons);
    placeMarks(element("marks"), buttons);
  }

  function redrawAll() {
    slider.max = longest();
    slider.step = 1 / rate;
    state.time = Math.min(state.time, longest());
    for (const box of boxes) box.disabled = !ofCase().some((run) => run.key === box.value);
    marks();
    fitScene();
    drawFigures();
    show();
  }

  let last = 0;
  function frame(now) {
    if (!state.playing) return;
    setTime(state.time + (Math.min(now - last, 100) / 1000) * Number(element("speed").value));
    last = now;
    if (state.time >= longest()) return setPlaying(false);
    requestAnimationFrame(frame);
  }

  function setPlaying(value) {
    state.playing = value;
    element("play").textContent = value ? "Pause" : "Play";
    if (!value) return;
    if (state.time >= longest()) state.time = 0;
    last = performance.now();
    requestAnimationFrame(frame);
  }

  element("play").addEventListener("click", () => setPlaying(!state.playing));
  slider.addEventListener("input", () => setTime(Number(slider.value)));
  element("case")?.addEventListener("change", () => { state.range = null; redrawAll(); });
  boxes.forEach((box) => box.addEventListener("change", redrawAll));
  document.querySelectorAll("#joints button, .matrix thead [data-joint]").forEach((button) =>
    button.addEventListener("click", () => chooseJoint(button.dataset.joint === "" ? null : Number(button.dataset.joint))),
  );
  document.querySelectorAll("[data-log]").forEach((box) => box.addEventListener("change", drawFigures));
  document.querySelectorAll("[data-time]").forEach((button) => button.addEventListener("click", () => {
    setTime(Number(button.dataset.time) - start());
    element("viewer").scrollIntoView();
  }));
  element("zoom-in").addEventListener("click", () => zoomBy(0.5));
  element("zoom-out").addEventListener("click", () => zoomBy(2));
  element("zoom-all").addEventListener("click", () => zoom(null));
  if (element("arm")) turnable(element("arm"), viewer.arm.view, show);
  redraws.push(redrawAll);
  chooseJoint(state.joint);
  viewer.state = state;
}

if (data.viewer) startViewer(data.viewer);
