// The arm: the points of its skeleton over time, seen from afar. Dragging and the arrow keys turn the view.

/** Orthographic view: from a point (m) to the drawing (m), y downwards, and depth (m), towards the viewer. */
function projection([azimuth, elevation], centre) {
  const [ca, sa, ce, se] = [Math.cos(azimuth), Math.sin(azimuth), Math.cos(elevation), Math.sin(elevation)];
  return ([px, py, pz]) => {
    const [x, y, z] = [px - centre[0], py - centre[1], pz - centre[2]];
    return [ca * y - sa * x, se * (ca * x + sa * y) - ce * z, ce * (ca * x + sa * y) + se * z];
  };
}

/** The lines on the ground below a sphere, as pairs of points. */
function groundLines([x, y], radius, step) {
  const range = (middle) => {
    const [first, last] = [Math.floor((middle - radius) / step), Math.ceil((middle + radius) / step)];
    return Array.from({ length: last - first + 1 }, (_, i) => (first + i) * step);
  };
  const [xs, ys] = [range(x), range(y)];
  return [...xs.map((at) => [[at, ys[0], 0], [at, ys.at(-1), 0]]), ...ys.map((at) => [[xs[0], at, 0], [xs.at(-1), at, 0]])];
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

/** A packed run with functions of a sample. */
function unpackArm(packed, unpackedReference) {
  const numbers = Object.fromEntries(["reached", "reference", "turns", "distance"].map((name) => [name, unpack(packed[name])]));
  const triples = (values, count, sample) => Array.from({ length: count }, (_, i) => values.subarray(3 * (sample * count + i), 3 * (sample * count + i + 1)));
  const points = packed.parents.length;
  return {
    ...packed,
    samples: numbers.distance.length,
    distance: (sample) => numbers.distance[sample],
    reached: (sample) => triples(numbers.reached, points, sample),
    hasReference: packed.reference_of !== "",
    hasFrames: numbers.turns.length > 0,
    referenceAt: (sample) => triples(numbers.reference.length ? numbers.reference : unpackedReference(packed.reference_of), points, sample),
    frames: (sample) => Array.from({ length: points - 1 }, (_, i) => matrixOf(numbers.turns.subarray(4 * (sample * (points - 1) + i), 4 * (sample * (points - 1) + i + 1)))),
    every: [numbers.reached, numbers.reference],
    numbers,
  };
}

const cross = ([a, b, c], [d, e, f]) => [b * f - c * e, c * d - a * f, a * e - b * d];

/** An effort at a joint, as a share of its limit: an arc about its axis with an arrow, or a line along it if it slides. */
function effortArc(point, axis, share, size, slides) {
  const along = (u, cu, v, cv) => point.map((x, i) => x + cu * u[i] + cv * v[i]);
  if (slides) return [point, along(axis, 3 * size * share, axis, 0)];
  const side = Math.abs(axis[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0];
  const raw = cross(axis, side);
  const u = raw.map((x) => x / Math.hypot(...raw));
  const v = cross(axis, u);
  const end = 2 * Math.PI * Math.max(-1, Math.min(1, share));
  const steps = Math.max(2, Math.ceil(Math.abs(end) * 5));
  const at = (angle, radius) => along(u, radius * Math.cos(angle), v, radius * Math.sin(angle));
  const arc = Array.from({ length: steps + 1 }, (_, k) => at((end * k) / steps, size));
  const head = end - Math.sign(end) * Math.min(0.35, Math.abs(end));
  return [...arc, at(head, 1.3 * size), arc.at(-1), at(head, 0.7 * size)];
}

/** From a point in the frame of a row (-1: the base) to the base, at a sample of a run; all m. */
function placer(arm, sample) {
  const [frames, points] = [arm.frames(sample), arm.reached(sample)];
  return (row) => {
    if (row < 0) return (x, y, z) => [x, y, z];
    const [r, p] = [frames[row], points[row]];
    return (x, y, z) => [r[0] * x + r[1] * y + r[2] * z + p[0], r[3] * x + r[4] * y + r[5] * z + p[1], r[6] * x + r[7] * y + r[8] * z + p[2]];
  };
}

/** Draws the shown runs at a time from the current view; the view fits their whole motion. */
function armDrawer(svg, { centre, radius, grid, view, meshes }, rate) {
  const trailTime = 2.0; // s
  const lines = groundLines(centre, radius, grid);
  const size = 0.09 * radius;
  const solids = meshes.map(unpackMesh);
  const paint = solids.length ? meshPainter(element("solid"), solids) : null;
  const beneath = element("ground"); // the solid arm
  let fitted = "";
  let box = []; // what the drawing shows: left, top, width, height, m

  const group = (name, run = "") => {
    const id = `arm-${name}${run === "" ? "" : `-${run}`}`;
    let found = element(id);
    if (!found) {
      found = document.createElementNS("http://www.w3.org/2000/svg", "path");
      found.id = id;
      found.setAttribute("class", name);
      (name === "ground" || name === "shadow" ? beneath : svg).append(found);
    }
    return found;
  };
  const bones = (points, { parents }) => points.map((point, i) => [parents[i] < 0 ? [0, 0, 0] : points[parents[i]], point]);
  const dots = (points) => points.map((point) => [point, point]);

  function fit(project, runs) {
    const key = JSON.stringify([view, runs.map((run) => run.name), svg.clientWidth, svg.clientHeight]);
    if (key === fitted) return;
    fitted = key;
    let [left, top, right, bottom] = [0, 0, 0, 0];
    const include = (point) => {
      const [x, y] = project(point);
      left = Math.min(left, x); right = Math.max(right, x); top = Math.min(top, y); bottom = Math.max(bottom, y);
    };
    include([0, 0, 0]);
    for (const run of runs) for (const values of run.arm.every) for (let i = 0; i < values.length; i += 3) include(values.subarray(i, i + 3));
    for (const { arm } of runs.filter((run) => run.arm.hasFrames)) {
      for (let k = 0; k < arm.samples; k += Math.ceil(arm.samples / 40)) {
        const at = placer(arm, k);
        for (const each of solids) for (const corner of each.box) include(at(each.row)(...corner));
      }
    }
    const margin = (solids.length ? 0.04 : 0.08) * Math.max(right - left, bottom - top) + 1e-3;
    box = [left - margin, top - margin, right - left + 2 * margin, bottom - top + 2 * margin];
    for (const each of [svg, beneath]) each.setAttribute("viewBox", box.map((x) => (1000 * x).toFixed(1)).join(" "));
  }

  /** Paint the solid arm where the lines of the drawing are. */
  function paintSolid(run, sample, toDrawing, joint) {
    const at = run ? placer(run.arm, sample) : null;
    const scale = Math.min(svg.clientWidth / box[2], svg.clientHeight / box[3]);
    const [left, top] = [svg.clientWidth / 2 - scale * (box[0] + box[2] / 2), svg.clientHeight / 2 - scale * (box[1] + box[3] / 2)];
    const place = (row) => {
      const toBase = at(row);
      return (x, y, z) => {
        const [u, v, depth] = toDrawing(toBase(x, y, z));
        return [left + scale * u, top + scale * v, depth];
      };
    };
    place.scale = scale;
    element("solid").hidden = !run;
    if (run) paint(place, joint === null ? NaN : run.arm.places.indexOf(joint));
  }

  return (runs, time, joint) => {
    const drawn = runs.filter((run) => run.arm);
    const toDrawing = projection(view, centre);
    fit(toDrawing, drawn);
    const path = (found, segments) => found.setAttribute("d", segments.map((points) => `M${points.map((p) => toDrawing(p).slice(0, 2).map((x) => (1000 * x).toFixed(2)).join(" ")).join("L")}`).join(""));
    for (const each of [svg, beneath]) each.querySelectorAll("[data-run]").forEach((part) => part.remove());
    path(group("ground"), lines);
    const ghosts = new Set();
    const framed = drawn.find((run) => run.arm.hasFrames);
    svg.classList.toggle("over-solid", Boolean(paint && framed));
    const sampleOf = (arm) => Math.max(0, Math.min(Math.round(time * rate), arm.samples - 1));
    if (paint) paintSolid(framed, framed ? sampleOf(framed.arm) : 0, toDrawing, joint);
    drawn.forEach(({ arm, colour, dashes, share }, index) => {
      const sample = sampleOf(arm);
      const points = arm.reached(sample);
      const begin = Math.max(0, sample - trailTime * rate);
      const add = (name, segments, stroke = "") => {
        const found = group(name, index);
        found.dataset.run = index;
        if (stroke) found.style.stroke = stroke;
        path(found, segments);
        return found;
      };
      const own = `var(--s${colour})`;
      if (drawn.length === 1 && Math.abs(Math.sin(view[1])) > 0.1) add("shadow", bones(points, arm).map((bone) => bone.map(([x, y]) => [x, y, 0])));
      add("trail", [Array.from({ length: sample - begin + 1 }, (_, k) => arm.reached(begin + k).at(-1))], own);
      add("links", bones(points, arm), own).style.strokeDasharray = index && dashes.length ? dashes.map((x) => 2 * x).join(" ") : "";
      add("turning", dots(points.slice(0, -1).filter((_, i) => !arm.sliding.includes(i))));
      add("sliding", dots(arm.sliding.map((i) => points[i])));
      add("tool", dots(points.slice(-1)));
      if (joint !== null) add("chosen", dots(points.slice(0, -1).filter((_, i) => arm.places[i] === joint)));
      if (arm.hasReference && !ghosts.has(arm.reference_of)) {
        ghosts.add(arm.reference_of);
        add("reference", bones(arm.referenceAt(sample), arm));
      }
      if (drawn.length === 1 && arm.hasFrames) {
        const axes = arm.frames(sample).map((frame) => [frame[2], frame[5], frame[8]]);
        add("arcs", axes.map((axis, i) => effortArc(points[i], axis, share(arm.places[i], sample), size, arm.sliding.includes(i))));
      }
    });
  };
}
