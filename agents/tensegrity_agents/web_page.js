const NS = "http://www.w3.org/2000/svg";
// An element of a drawing.
function draw(parent, tag, attributes, text) {
  const made = document.createElementNS(NS, tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  if (text !== undefined) made.textContent = text;
  parent.appendChild(made);
  return made;
}
// Ticks at round numbers: 1, 2 or 5 times a power of ten.
function ticks(low, high, count = 10) {
  const rough = (high - low) / count, decade = 10 ** Math.floor(Math.log10(rough)), step = [1, 2, 5, 10].map(m => m * decade).find(s => s >= rough);
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) found.push(+(k * step).toPrecision(12));
  return found;
}
