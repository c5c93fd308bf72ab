const data = JSON.parse(document.getElementById("data").textContent);
const element = (id) => document.getElementById(id);

/** Numbers of packed.py: little-endian floats in base64. */
function unpack(text) {
  return new Float32Array(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);
}

/** The value of a custom property of the style, such as --ink. */
const look = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

/** Called when everything must be drawn again: the colours have changed, or what was folded is open. */
const redraws = [];
const redraw = () => redraws.forEach((each) => each());
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
matchMedia("print").addEventListener("change", redraw);

// A page that is printed has nothing folded.
let opened = [];
window.addEventListener("beforeprint", () => {
  opened = [...document.querySelectorAll("details:not([open])")];
  opened.forEach((each) => { each.open = true; });
  redraw();
});
window.addEventListener("afterprint", () => opened.forEach((each) => { each.open = false; }));
document.querySelectorAll("details").forEach((each) => each.addEventListener("toggle", redraw));

let waiting = 0;
window.addEventListener("resize", () => {
  clearTimeout(waiting);
  waiting = setTimeout(redraw, 100);
});
