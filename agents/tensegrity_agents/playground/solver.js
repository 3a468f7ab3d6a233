// Searches that know no equation: roots of a function of one number, Newton's method for two, and both of two X-joints.

// Where f changes sign between low and high (Chandrupatla's method).
function rootBetween(f, low, high, fLow, fHigh) {
  let a = high, b = low, c = high, fa = fHigh, fb = fLow, fc = fHigh, t = 0.5;
  for (let n = 0; n < 80; n++) {
    const x = a + t * (b - a), fx = f(x);
    if (Math.sign(fx) === Math.sign(fa)) { c = a; fc = fa; } else { c = b; fc = fb; b = a; fb = fa; }
    a = x; fa = fx;
    const best = Math.abs(fa) < Math.abs(fb) ? a : b, tolerance = 4.5e-16 * Math.abs(best) + 1e-300, width = Math.abs(b - a);
    if (fa === 0 || width <= 2 * tolerance) break;
    const xi = (a - b) / (c - b), phi = (fa - fb) / (fc - fb);
    t = phi * phi < xi && (1 - phi) * (1 - phi) < 1 - xi
      ? fa / (fb - fa) * fc / (fb - fc) + (c - a) / (b - a) * fa / (fc - fa) * fb / (fc - fb) : 0.5;
    const least = Math.min(tolerance / width, 0.5);
    t = Math.min(Math.max(t, least), 1 - least);
  }
  return Math.abs(fa) <= Math.abs(fb) ? a : b;
}

// All roots of f from low to high, which is one turn where f is periodic: sign changes between samples, and pairs of
// them that hide in a hump or a dip between two samples.
function rootsOf(f, low, high, samples, periodic) {
  const step = (high - low) / samples, values = new Float64Array(samples + 1), found = [];
  for (let i = 0; i <= samples; i++) values[i] = f(low + i * step);
  const between = (x0, f0, x1, f1) => { if ((f0 > 0) !== (f1 > 0)) found.push(rootBetween(f, x0, x1, f0, f1)); };
  for (let i = 0; i < samples; i++) between(low + i * step, values[i], low + (i + 1) * step, values[i + 1]);
  for (let i = periodic ? 0 : 1; i < samples; i++) {
    const left = values[i > 0 ? i - 1 : samples - 1], middle = values[i], right = values[i + 1], sign = middle > 0 ? 1 : -1;
    if (!(sign * left > 0 && sign * right > 0 && sign * middle <= sign * left && sign * middle <= sign * right)) continue;
    const bend = left - 2 * middle + right, lowest = middle - (right - left) ** 2 / (8 * bend);
    if (sign * lowest > 0.3 * Math.abs(bend)) continue;  // far from zero
    const x = low + i * step, golden = 0.6180339887498949;
    let p = x - step, q = x + step, u = q - golden * (q - p), v = p + golden * (q - p), fu = sign * f(u), fv = sign * f(v);
    for (let n = 0; n < 40 && fu > 0 && fv > 0; n++) {
      if (fu < fv) { q = v; v = u; fv = fu; u = q - golden * (q - p); fu = sign * f(u); }
      else { p = u; u = v; fu = fv; v = p + golden * (q - p); fv = sign * f(v); }
    }
    if (fu <= 0 || fv <= 0) {
      const place = fu <= 0 ? u : v, there = sign * (fu <= 0 ? fu : fv);
      between(x - step, left, place, there);
      between(place, there, x + step, right);
    }
  }
  return found;
}

// Newton's method for two equations: at(q) gives {tip, jacobian}; steps that lead further away are shortened.
function newton(at, q, target, longest) {
  let here = at(q), ex = here.tip[0] - target[0], ey = here.tip[1] - target[1], error = Math.hypot(ex, ey);
  for (let n = 0; n < 40 && error > 0; n++) {
    const [[xa, xb], [ya, yb]] = here.jacobian, det = xa * yb - xb * ya;
    let s = (yb * ex - xb * ey) / det, t = (xa * ey - ya * ex) / det;
    const size = Math.hypot(s, t);
    if (!(size > 0) || size === Infinity) break;
    let part = Math.min(1, longest / size), better = false;
    for (let k = 0; k < 8 && !better; k++, part /= 4) {
      const next = [q[0] - part * s, q[1] - part * t], there = at(next);
      const nx = there.tip[0] - target[0], ny = there.tip[1] - target[1], left = Math.hypot(nx, ny);
      if (left < error) { q = next; here = there; ex = nx; ey = ny; error = left; better = true; }
    }
    if (!better) break;
  }
  return {q, error};
}

const wrapped = (angle, turn) => angle - turn * Math.ceil((angle - turn / 2) / turn);  // into (-turn / 2, turn / 2]

const FULL_TURN = 4 * Math.PI;  // of an angle alpha: the middle line of an X-joint turns by half of it

// Angles of two X-joints that put the tip on a target: roots of `off` along the circle of the first joint's eccentric
// anomaly, where `start` gives the angles; `at` is as Newton's method takes it.
function pairs({off, start, at}, [x, y], {l, a, joint_limit: given}, samples) {
  const found = [], reach = 2 * (l + a), limit = Math.min(given, given <= Math.PI ? Math.PI - 1e-9 : given);
  if (Math.hypot(x, y) > reach) return found;
  for (const psi of rootsOf(off, 0, 2 * Math.PI, samples, true)) {
    const first = start(psi), starts = [first.q];
    // Where the curve crosses itself, one alpha_1 has two alpha_2.
    if (Math.abs(first.u) < 1e-3 * l ** 2)
      for (let k = 0; k < 12; k++) starts.push([first.q[0], FULL_TURN * (k / 12 - 0.5)]);
    for (const q of starts) {
      if (Math.abs(q[0]) > given + 0.1) continue;
      const solution = newton(at, q, [x, y], 0.3), angles = solution.q.map(angle => wrapped(angle, FULL_TURN));
      if (solution.error > 1e-12 * reach || Math.max(...angles.map(Math.abs)) > limit) continue;
      const gap = (p, q) => Math.abs(wrapped(p - q, FULL_TURN));
      if (!found.some(p => gap(p[0], angles[0]) + gap(p[1], angles[1]) < 1e-6)) found.push(angles);
    }
  }
  return found.sort((p, q) => p[0] - q[0] || p[1] - q[1]);
}
