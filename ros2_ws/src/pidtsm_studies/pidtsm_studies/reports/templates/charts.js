// Charts of anything over anything: lines and points over a common, increasing axis.

function drawChart(box) {
  const chart = data.charts[box.dataset.chart];
  const columns = chart.series.map((series) => series.y);
  plotInto(
    box,
    {
      scales: {
        x: { time: false, distr: chart.x_log ? 3 : 1, dir: chart.reversed ? -1 : 1 },
        y: { distr: chart.y_log ? 3 : 1, ...(chart.y_range.length ? { range: chart.y_range } : chart.y_log ? {} : { range: roomy }) },
      },
      axes: axes("", ""),
      series: [{}, ...chart.series.map((series) => ({
        ...line(series),
        show: !hiddenSeries.has(series.label),
        paths: series.points ? () => null : undefined,
        points: { show: true, size: series.points || 5, fill: look(`--s${series.colour}`), stroke: look(`--s${series.colour}`) },
      }))],
      cursor: { drag: { x: true, y: false } },
    },
    [chart.x, ...columns],
  );
}

const hiddenSeries = new Set();
const drawCharts = () => document.querySelectorAll("[data-chart]").forEach(drawChart);
if (Object.keys(data.charts).length) {
  redraws.push(drawCharts);
  drawCharts();
}
