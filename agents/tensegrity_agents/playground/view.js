// Plots, sliders and the table; what is shown comes from MECHANISM.
const S = JSON.parse(document.getElementById("settings").textContent);
const COLOURS = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#882255", "#7a7a00", "#332288", "#0096c7"];
const GRIDS = [20, 120];  // cells along the longer axis: at once, and when there is time
const element = id => document.getElementById(id);
let inputs;

function begin() {
  inputs = {target: [...S.start], design: {...S.design}, load: [], extra: {}};
  for (const slider of S.sliders) for (const key of slider.keys) inputs[slider.group][key] = slider.value;
}
function shown(value) {
  if (!Number.isFinite(value)) return Number.isNaN(value) ? "–" : "∞";
  return Math.abs(value) < 1e-12 ? 0 : Math.abs(value) < 5e-5 ? value.toExponential(2) : +value.toPrecision(4);
}

class Plot {
  constructor(id, plane) { this.svg = element(id); this.plane = plane; this.job = 0; }
  // One unit is one pixel, so that letters keep their size on a narrow screen.
  layout() {
    const {svg, plane} = this, [x0, y0, x1, y1] = plane.bounds, width = Math.max(svg.clientWidth, 260);
    this.left = 52; this.top = 8;
    this.width = width - this.left - 10;
    this.height = plane.equal ? this.width * (y1 - y0) / (x1 - x0) : Math.min(this.width, 420);
    const bottom = this.top + this.height;
    svg.setAttribute("viewBox", `0 0 ${width} ${bottom + 46}`);
    svg.style.height = `${bottom + 46}px`;
    svg.replaceChildren();
    draw(svg, "clipPath", {id: `clip-${svg.id}`}).append(draw(svg, "rect", {x: this.left, y: this.top, width: this.width, height: this.height}));
    this.image = draw(svg, "image", {x: this.left, y: this.top, width: this.width, height: this.height, preserveAspectRatio: "none", style: "image-rendering: pixelated"});
    for (const t of ticks(x0, x1, this.width / 62)) {
      const [u] = this.at([t, y0]);
      draw(svg, "line", {x1: u, y1: bottom, x2: u, y2: this.top, stroke: "#0002"});
      draw(svg, "text", {x: u, y: bottom + 19, "text-anchor": "middle", class: "tick"}, t);
    }
    for (const t of ticks(y0, y1, this.height / 46)) {
      const [, v] = this.at([x0, t]);
      draw(svg, "line", {x1: this.left, y1: v, x2: this.left + this.width, y2: v, stroke: "#0002"});
      draw(svg, "text", {x: this.left - 6, y: v + 4, "text-anchor": "end", class: "tick"}, t);
    }
    draw(svg, "rect", {x: this.left, y: this.top, width: this.width, height: this.height, fill: "none", stroke: "#555c66"});
    draw(svg, "text", {x: this.left + this.width / 2, y: bottom + 38, "text-anchor": "middle"}, plane.axes[0]);
    const middle = this.top + this.height / 2;
    draw(svg, "text", {x: 11, y: middle, "text-anchor": "middle", transform: `rotate(-90 11 ${middle})`}, plane.axes[1]);
    this.layer = draw(svg, "g", {"clip-path": `url(#clip-${svg.id})`});
  }
  at([x, y]) {
    const [x0, y0, x1, y1] = this.plane.bounds;
    return [this.left + this.width * (x - x0) / (x1 - x0), this.top + this.height * (y1 - y) / (y1 - y0)];
  }
  from(event) {
    const box = this.svg.getBoundingClientRect(), [x0, y0, x1, y1] = this.plane.bounds;
    const u = (event.clientX - box.left - this.left) / this.width, v = (event.clientY - box.top - this.top) / this.height;
    return [x0 + Math.min(Math.max(u, 0), 1) * (x1 - x0), y1 - Math.min(Math.max(v, 0), 1) * (y1 - y0)];
  }
  path(points) { return points.map((p, i) => (i ? "L" : "M") + this.at(p).map(v => v.toFixed(2)).join(",")).join(""); }
  arm(solution, colour) {
    const [i, j] = this.plane.project;
    for (const [kind, first, last] of S.members) {
      const ends = [first, last].map(name => solution.nodes[name]).map(p => [p[i], p[j]]), soft = kind === "spring" || kind === "cable";
      draw(this.layer, "path", {d: this.path(ends), class: "arm", fill: "none", stroke: colour, "stroke-linecap": "round",
        "stroke-width": soft ? 1.2 : kind === "actuator" ? 3.5 : 2.2, "stroke-dasharray": soft ? "4 3" : "none", opacity: solution.usable ? 1 : 0.3});
    }
  }
  // Colours of cells, coarse at once and fine afterwards, some milliseconds at a time so that dragging stays smooth.
  raster(colourOf) {
    const job = ++this.job, [x0, y0, x1, y1] = this.plane.bounds, canvas = document.createElement("canvas");
    let pass = 0, row = 0, columns, rows;
    const size = () => {
      const n = GRIDS[pass], ratio = (y1 - y0) / (x1 - x0) * (this.plane.equal ? 1 : (x1 - x0) / (y1 - y0));
      columns = ratio > 1 ? Math.round(n / ratio) : n; rows = ratio > 1 ? n : Math.round(n * ratio);
      canvas.width = columns; canvas.height = rows; row = 0;
    };
    size();
    const work = () => {
      if (job !== this.job) return;
      const pen = canvas.getContext("2d"), until = performance.now() + 14;
      while (row < rows && performance.now() < until) {
        for (let column = 0; column < columns; column++) {
          pen.fillStyle = colourOf([x0 + (column + 0.5) * (x1 - x0) / columns, y1 - (row + 0.5) * (y1 - y0) / rows]);
          pen.fillRect(column, row, 1, 1);
        }
        row++;
      }
      if (row < rows) { setTimeout(work); return; }
      this.image.setAttribute("href", canvas.toDataURL());
      if (++pass < GRIDS.length) { size(); setTimeout(work); } else this.svg.dataset.done = job;
    };
    work();
  }
}

const plots = {main: new Plot("main", S.main), second: new Plot("second", S.second)};

function show() {
  const solutions = MECHANISM.solve(inputs), {main, second} = plots, rules = MECHANISM.second;
  const focused = document.activeElement?.id;
  for (const plot of [main, second]) plot.layer.replaceChildren();
  for (const line of rules.curves?.(inputs) ?? [])
    draw(second.layer, "path", {d: second.path(line.points), fill: "none", stroke: COLOURS[line.k], "stroke-width": 1.8, "stroke-dasharray": line.dashed ? "3 4" : "none"});
  for (const plot of [main, second]) if (plot.plane.project)
    [...solutions.keys()].sort((a, b) => solutions[a].usable - solutions[b].usable).forEach(k => plot.arm(solutions[k], COLOURS[k % COLOURS.length]));
  if (rules.points) solutions.forEach((solution, k) => {
    const [u, v] = second.at(rules.points(solution)), colour = COLOURS[k % COLOURS.length];
    draw(second.layer, "circle", {cx: u, cy: v, r: 6, fill: solution.usable ? colour : "#fff", stroke: colour, "stroke-width": 2.5, class: "solution"});
  });
  handle(main, "tip", inputs.target);
  if (rules.handle) handle(second, "other", rules.handle(inputs));
  if (focused === "tip" || focused === "other") element(focused)?.focus();
  const usable = solutions.filter(s => s.usable).length;
  element("count").textContent = `(${inputs.target.map(v => shown(v)).join(", ")}) ${S.main.axes[0].match(/\[(.*)\]/)[1]}: ` +
    `${solutions.length} ${solutions.length === 1 ? "solution" : "solutions"}, ${usable} of them held in stable equilibrium`;
  const heads = solutions.map((s, k) => `<th scope="col"><span class="dot" style="border-color:${COLOURS[k % COLOURS.length]};background:${s.usable ? COLOURS[k % COLOURS.length] : "#fff"}"></span>${s.label}</th>`);
  element("table").innerHTML = solutions.length ? `<thead><tr><th scope="row"></th>${heads.join("")}</tr></thead><tbody>` + S.quantities.map((name, i) =>
    `<tr><th scope="row">${name}</th>${solutions.map(s => `<td>${shown(s.values[i])}</td>`).join("")}</tr>`).join("") + "</tbody>" : "";
}
function handle(plot, id, place) {
  const [u, v] = plot.at(place);
  draw(plot.layer, "circle", {id, cx: u, cy: v, r: 9, class: "handle", tabindex: 0, fill: "#e69f00", stroke: "#1e242c", "stroke-width": 1.5,
    "aria-label": "tip: drag it, or use the arrow keys"});
}
function rasters() {
  const colour = S.classes.map(([, c]) => c), now = {...inputs, extra: {...inputs.extra}, load: [...inputs.load], design: {...inputs.design}};
  plots.main.raster(target => colour[MECHANISM.classOf({...now, target})]);
  const rules = MECHANISM.second;
  if (rules.cell) plots.second.raster(point => rules.classes[rules.cell(now, point)]);
}
function sliders() {
  element("sliders").replaceChildren(...S.sliders.map((slider, i) => {
    const label = document.createElement("label"), value = inputs[slider.group][slider.keys[0]];
    label.innerHTML = `<span>${slider.label}</span><output>${shown(value)}</output>` +
      `<input id="slider-${i}" type="range" min="${slider.low}" max="${slider.high}" step="${slider.step}" value="${value}">`;
    label.querySelector("input").addEventListener("input", event => {
      for (const key of slider.keys) inputs[slider.group][key] = +event.target.value;
      label.querySelector("output").textContent = shown(+event.target.value);
      show();
      if (!(slider.group === "extra" && slider.keys[0] === "q1")) rasters();
    });
    return label;
  }));
}
// New values, of a target or of an extra number, as a plot gives them.
function take(change) {
  if (change.target) inputs.target = change.target;
  const before = inputs.extra.z;
  Object.assign(inputs.extra, change.extra);
  S.sliders.forEach((slider, i) => {
    if (slider.group !== "extra") return;
    element(`slider-${i}`).value = inputs.extra[slider.keys[0]];
    element(`slider-${i}`).previousSibling.textContent = shown(inputs.extra[slider.keys[0]]);
  });
  show();
  if (inputs.extra.z !== before) rasters();
}
function drag(plot, move) {
  plot.svg.addEventListener("pointerdown", event => { plot.svg.setPointerCapture(event.pointerId); move(plot.from(event)); event.preventDefault(); });
  plot.svg.addEventListener("pointermove", event => { if (event.buttons) move(plot.from(event)); });
}
drag(plots.main, target => take({target}));
if (MECHANISM.second.pick) drag(plots.second, point => take(MECHANISM.second.pick(inputs, point)));
else plots.second.svg.style.cursor = "default";
const STEPS = {ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1]};
document.addEventListener("keydown", event => {
  const way = STEPS[event.key], id = document.activeElement?.id;
  if (!way || (id !== "tip" && id !== "other")) return;
  event.preventDefault();
  const plot = id === "tip" ? plots.main : plots.second, [x0, y0, x1] = plot.plane.bounds, step = (x1 - x0) / (event.shiftKey ? 1000 : 100);
  const from = id === "tip" ? inputs.target : MECHANISM.second.handle(inputs), to = [from[0] + step * way[0], from[1] + step * way[1]];
  take(id === "tip" ? {target: to} : MECHANISM.second.pick(inputs, to));
});
function restart() { begin(); sliders(); arrange(); }
function arrange() { for (const plot of Object.values(plots)) plot.layout(); show(); rasters(); }
element("reset").addEventListener("click", restart);
element("caption").textContent = S.second.caption;
element("legend").innerHTML = S.classes.map(([label, colour]) => `<li><span class="swatch" style="background:${colour}"></span>${label}</li>`).join("");
let known = innerWidth;
addEventListener("resize", () => { if (innerWidth !== known) { known = innerWidth; arrange(); } });
restart();
