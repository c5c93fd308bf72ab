// Filters of a page: what belongs to a box that is not checked is hidden, in tables, sections and charts.

const filters = [...document.querySelectorAll("[data-filter]")];

function applyFilters() {
  const off = filters.filter((box) => box.type === "checkbox" && !box.checked);
  for (const each of document.querySelectorAll("[data-tags]")) {
    const tags = JSON.parse(each.dataset.tags);
    each.hidden = off.some((box) => tags[box.dataset.filter] === box.value);
  }
  for (const choice of filters.filter((each) => each.tagName === "SELECT")) {
    for (const each of document.querySelectorAll(`[data-${choice.dataset.filter}]`)) each.hidden = each.dataset[choice.dataset.filter] !== choice.value;
  }
  hiddenSeries.clear();
  for (const box of off) for (const label of JSON.parse(box.dataset.series || "[]")) hiddenSeries.add(label);
  const rows = [...document.querySelectorAll("tr[data-tags]")];
  const count = document.getElementById("filtered");
  if (count) count.textContent = `${rows.filter((row) => row.checkVisibility()).length} of ${rows.length} rows shown`;
  redraw();
}

filters.forEach((box) => box.addEventListener("change", applyFilters));
