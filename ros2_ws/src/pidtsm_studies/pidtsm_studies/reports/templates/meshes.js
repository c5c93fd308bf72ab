// The solid arm: triangles painted from the farthest to the nearest, so that no graphics card is needed.

const SHADES = 24;

/** Rotate by a quaternion [x, y, z, w] as a matrix, row by row. */
function matrixOf([x, y, z, w]) {
  return [
    1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w),
    2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w),
    2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y),
  ];
}

/** A mesh of meshes.py with the corners of its box, by which the view fits. */
function unpackMesh({ row, corners, triangles }) {
  const points = unpack(corners);
  const range = [0, 1, 2].map((axis) => {
    const values = points.filter((_, i) => i % 3 === axis);
    return [Math.min(...values), Math.max(...values)];
  });
  const box = range[0].flatMap((x) => range[1].flatMap((y) => range[2].map((z) => [x, y, z])));
  return { row, points, triangles: Uint16Array.from(unpack(triangles)), box };
}

/** Colours from dark to light, between two properties of the style. */
function shadesOf(dark, light) {
  const channels = (name) => look(name).match(/\w\w/g).map((pair) => parseInt(pair, 16));
  const [from, to] = [channels(dark), channels(light)];
  return Array.from({ length: SHADES }, (_, k) => `rgb(${from.map((x, i) => Math.round(x + ((to[i] - x) * k) / (SHADES - 1))).join(" ")})`);
}

/** Paints meshes into a canvas: `place` maps a point of a row to x, y (px) and depth (m, towards the viewer). */
function meshPainter(canvas, meshes) {
  const corners = meshes.reduce((sum, mesh) => sum + mesh.points.length / 3, 0);
  const count = meshes.reduce((sum, mesh) => sum + mesh.triangles.length / 3, 0);
  const [xs, ys, depths] = [new Float32Array(corners), new Float32Array(corners), new Float32Array(corners)];
  const triangles = new Uint16Array(3 * count);
  const rows = new Int16Array(count);
  let [corner, triangle] = [0, 0];
  for (const mesh of meshes) {
    rows.fill(mesh.row, triangle, triangle + mesh.triangles.length / 3);
    mesh.triangles.forEach((index, i) => { triangles[3 * triangle + i] = index + corner; });
    corner += mesh.points.length / 3;
    triangle += mesh.triangles.length / 3;
  }
  const middle = new Float32Array(count);
  const order = Array.from({ length: count }, (_, i) => i);

  return (place, chosenRow) => {
    const ctx = canvas.getContext("2d");
    const ratio = devicePixelRatio;
    const [width, height] = [Math.round(canvas.clientWidth * ratio), Math.round(canvas.clientHeight * ratio)];
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    ctx.clearRect(0, 0, width, height);
    ctx.lineWidth = 0.8 * ratio;
    ctx.lineJoin = "round";
    const plain = shadesOf("--mesh-dark", "--mesh-light");
    const chosen = shadesOf("--mesh-chosen-dark", "--mesh-chosen-light");
    let next = 0;
    for (const { row, points } of meshes) {
      const at = place(row);
      for (let i = 0; i < points.length; i += 3, next++) {
        const [x, y, depth] = at(points[i], points[i + 1], points[i + 2]);
        xs[next] = x * ratio; ys[next] = y * ratio; depths[next] = depth;
      }
    }
    for (let k = 0; k < count; k++) middle[k] = depths[triangles[3 * k]] + depths[triangles[3 * k + 1]] + depths[triangles[3 * k + 2]];
    order.sort((a, b) => middle[a] - middle[b]);
    const scale = place.scale * ratio; // px in a metre of depth
    for (const k of order) {
      const [a, b, c] = [triangles[3 * k], triangles[3 * k + 1], triangles[3 * k + 2]];
      const [ux, uy, uz] = [xs[b] - xs[a], ys[b] - ys[a], scale * (depths[b] - depths[a])];
      const [vx, vy, vz] = [xs[c] - xs[a], ys[c] - ys[a], scale * (depths[c] - depths[a])];
      const [nx, ny, nz] = [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx];
      const facing = (nz < 0 ? -1 : 1) / (Math.hypot(nx, ny, nz) || 1); // The side that is seen counts.
      const light = facing * (0.75 * nz - 0.35 * nx - 0.55 * ny); // from the upper left
      const shade = Math.max(0, Math.min(SHADES - 1, Math.round((SHADES - 1) * (0.25 + 0.75 * Math.max(0, light)))));
      ctx.fillStyle = ctx.strokeStyle = (rows[k] === chosenRow ? chosen : plain)[shade];
      ctx.beginPath();
      ctx.moveTo(xs[a], ys[a]);
      ctx.lineTo(xs[b], ys[b]);
      ctx.lineTo(xs[c], ys[c]);
      ctx.closePath();
      ctx.fill();
      ctx.stroke(); // Otherwise the background is seen between triangles.
    }
  };
}
