// Plots with uPlot in the style of the page.

/** How much larger than usual letters and lines are, as on a very wide screen. */
const enlarged = () => parseFloat(getComputedStyle(document.documentElement).fontSize) / 16;

/** Axes of a plot: numbers as people write them, and as few ticks as are legible. */
function axes(xLabel, yLabel) {
  const size = enlarged();
  const font = `${12 * size}px system-ui, sans-serif`;
  const common = { stroke: look("--soft"), grid: { stroke: look("--line"), width: 1 }, ticks: { stroke: look("--line"), width: 1 }, font, labelFont: font };
  const values = (_, splits) => splits.map((split) => (split === null ? "" : written(split, 6)));
  return [
    { ...common, values, size: 26 * size, label: xLabel, labelSize: xLabel ? 16 * size : 0, space: 50 * size },
    { ...common, values, size: 58 * size, label: yLabel, labelSize: yLabel ? 18 * size : 0, space: 20 * size },
  ];
}

/** The look of a line; `faded` lines stay in the background. */
function line(looks, faded = false) {
  return {
    stroke: look(`--s${looks.colour}`),
    width: (faded ? 1 : 1.8) * enlarged(),
    alpha: faded ? 0.25 : 1,
    dash: looks.dashes.length ? looks.dashes : undefined,
    points: { show: false },
    spanGaps: true,
  };
}

/** Range of an axis with some space above and below. */
function roomy(_, low, high) {
  if (low === null) return [-1, 1];
  const space = high > low ? 0.06 * (high - low) : Math.abs(high) || 1;
  return [low - space, high + space];
}

/** Draw a plot anew into a box; a box that is not visible stays empty. */
function plotInto(box, options, table) {
  if (box.plot) box.plot.destroy();
  box.plot = null;
  if (!box.checkVisibility() || !box.clientWidth) return null;
  box.plot = new uPlot({ width: box.clientWidth, height: box.clientHeight, legend: { show: false }, padding: [8, 10, 0, 0], ...options }, table, box);
  return box.plot;
}
