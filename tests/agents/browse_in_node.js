// Runs the script of a page for browsing with as little of a browser as it needs; prints what a point shows.
const fs = require("fs");
const html = fs.readFileSync(process.argv[2], "utf8"), [x, y] = process.argv.slice(3).map(Number);
const data = html.match(/<script id="data"[^>]*>([\s\S]*?)<\/script>/)[1], code = html.match(/<script>([\s\S]*?)<\/script>/)[1];
const made = [];
const element = tag => ({tag, attributes: {}, children: [], listeners: {}, textContent: "", innerHTML: "",
  setAttribute(k, v) { this.attributes[k] = v; }, appendChild(c) { this.children.push(c); made.push(c); },
  replaceChildren() { this.children = []; }, addEventListener(k, f) { this.listeners[k] = f; }});
const known = {data: {textContent: data}};
global.document = {getElementById: id => known[id] ||= element(id), createElementNS: (_, tag) => element(tag), addEventListener() {}};
global.location = {hash: `#${x},${y}`};
global.addEventListener = () => {};
global.atob = text => Buffer.from(text, "base64").toString("latin1");
new Function(code)();
const layers = made.filter(e => e.tag === "g").flatMap(e => e.children);
console.log(JSON.stringify({
  ticks: made.filter(e => e.attributes.class === "tick").map(e => String(e.textContent)),
  labels: made.filter(e => e.tag === "text" && e.attributes.class !== "tick").map(e => e.textContent),
  arms: layers.filter(e => e.attributes.class === "arm").length, info: known.info.innerHTML,
}));
