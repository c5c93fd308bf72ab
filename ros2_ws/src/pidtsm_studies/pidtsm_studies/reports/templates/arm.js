// The arm: the points of its skeleton over time, seen from afar. Dragging and the arrow keys turn the view.

/** Orthographic view: from a point (m) to the drawing, whose half height is 1, y downwards. */
function projection([azimuth, elevation], centre, radius) {
  const [ca, sa, ce, se] = [Math.cos(azimuth), Math.sin(azimuth), Math.cos(elevation), Math.sin(elevation)];
  return (point) => {
    const [x, y, z] = [0, 1, 2].map((i) => (point[i] - centre[i]) / radius);
    return [ca * y - sa * x, se * (ca * x + sa * y) - ce * z];
  };
}

/** The lines on the ground below a sphere, as pairs of points. */
function groundLines([x, y], radius, step) {
  const range = (middle) => {
    const [first, last] = [Math.floor((middle - radius) / step), Math.ceil((middle + radius) / step)];
    return Array.from({ length: last - first + 1 }, (_, i) => (first + i) * step);
  };
  const [xs, ys] = [range(x), range(y)];
  return [
    ...xs.map((at) => [[at, ys[0], 0], [at, ys.at(-1), 0]]),
    ...ys.map((at) => [[xs[0], at, 0], [xs.at(-1), at, 0]]),
  ];
}

/** Move the view [azimuth, elevation] when the element is dragged, or an arrow key is pressed. */
function turnable(drawing, view, changed) {
  const keyStep = Math.PI / 36;
  function turn(azimuth, elevation) {
    view[0] += azimuth;
    view[1] = Math.max(-Math.PI / 2, Math.min(Math.PI / 2, view[1] + elevation));
    changed();
  }
  let at; // the last place of the pointer
  drawing.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    drawing.setPointerCapture(event.pointerId);
    at = event;
  });
  drawing.addEventListener("pointermove", (event) => {
    if (!drawing.hasPointerCapture(event.pointerId)) return;
    const turned = Math.PI / drawing.clientHeight;
    turn((at.clientX - event.clientX) * turned, (event.clientY - at.clientY) * turned);
    at = event;
  });
  const keys = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
  drawing.addEventListener("keydown", (event) => {
    const direction = keys[event.key];
    if (!direction || event.ctrlKey || event.altKey || event.metaKey) return;
    event.preventDefault(); // The page must not scroll.
    turn(...direction.map((sign) => sign * keyStep));
  });
}

/** Draws a run at a time from the current view. */
function drawer({ centre, radius, grid, rate, view }) {
  const trailTime = 2.0; // s
  const lines = groundLines(centre, radius, grid);
  let project;

  function path(id, segments) {
    const text = segments.map((points) => "M" + points.map((p) => project(p).map((x) => x.toFixed(5)).join(" ")).join("L"));
    element(id).setAttribute("d", text.join(""));
  }

  /** The skeleton as lines; the base is the origin. */
  const bones = (points, { parents }) => points.map((point, i) => [parents[i] < 0 ? [0, 0, 0] : points[parents[i]], point]);

  return (run, sample) => {
    project = projection(view, centre, radius);
    const dots = (points) => points.map((point) => [point, point]);
    const points = run.points(run.reached, sample);
    const begin = Math.max(0, sample - trailTime * rate);
    path("arm-ground", lines);
    path("arm-shadow", bones(points, run).map((bone) => bone.map(([x, y]) => [x, y, 0])));
    element("arm-shadow").style.opacity = Math.abs(Math.sin(view[1])); // From the side it would look like a link.
    path("arm-trail", [Array.from({ length: sample - begin + 1 }, (_, k) => run.points(run.reached, begin + k).at(-1))]);
    path("arm-reference", bones(run.points(run.reference, sample), run));
    path("arm-links", bones(points, run));
    path("arm-turning", dots(points.slice(0, -1).filter((_, i) => !run.sliding.includes(i))));
    path("arm-sliding", dots(run.sliding.map((i) => points[i])));
    path("arm-tool", dots(points.slice(-1)));
  };
}

/** A run whose numbers are unpacked. */
function unpackRun(packed) {
  const numbers = ["reached", "reference", "error", "distance"].map((name) => [name, unpack(packed[name])]);
  const count = packed.parents.length;
  const points = (values, sample) =>
    Array.from({ length: count }, (_, i) => values.subarray(3 * (sample * count + i), 3 * (sample * count + i + 1)));
  return { ...packed, ...Object.fromEntries(numbers), points };
}

function animate(arm) {
  const [slider, play, caseChoice, lawChoice] = ["time", "play", "case", "law"].map((name) => element(`arm-${name}`));
  const draw = drawer(arm);
  let run;
  let playing = false;
  let last = 0;

  function show() {
    const time = Number(slider.value);
    const sample = Math.min(Math.round(time * arm.rate), run.distance.length - 1);
    draw(run, sample);
    element("arm-clock").value = `${time.toFixed(2)} s`;
    run.units.forEach((unit, joint) => {
      element(`arm-error-${joint}`).value = `${run.error[sample * run.units.length + joint].toExponential(3)} ${unit}`;
    });
    element("arm-distance").value = `${(1000 * run.distance[sample]).toPrecision(4)} mm`;
    slider.setAttribute("aria-valuetext", `${time.toFixed(2)} seconds`);
    const happened = element("arm-event");
    happened.hidden = run.event === null;
    if (run.event !== null) {
      happened.textContent = `${time < run.event ? "Before" : "After"} the event at ${run.event} s.`;
    }
  }

  function choose() {
    for (const option of lawChoice.options) option.disabled = !(`${caseChoice.value} ${option.value}` in arm.runs);
    if (lawChoice.selectedOptions[0].disabled) lawChoice.value = [...lawChoice.options].find((o) => !o.disabled).value;
    run = unpackRun(arm.runs[`${caseChoice.value} ${lawChoice.value}`]);
    slider.max = (run.distance.length - 1) / arm.rate;
    slider.step = 1 / arm.rate;
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
  turnable(element("arm-drawing"), arm.view, show);
  choose();
}

if (data.arm) animate(data.arm);
