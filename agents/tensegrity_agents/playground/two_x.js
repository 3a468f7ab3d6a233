// The 2-X manipulator. Every solution's first joint is a root along the circle of its eccentric anomaly.
const FULL_TURN = 4 * Math.PI;  // of an angle alpha: the middle line of a joint turns by half of it

function inverse(design, [x, y], samples) {
  const found = [], reach = 2 * (design.l + design.a), at = q => place(design, q);
  const limit = Math.min(design.joint_limit, design.joint_limit <= Math.PI ? Math.PI - 1e-9 : design.joint_limit);
  if (Math.hypot(x, y) > reach) return found;
  for (const psi of rootsOf(angle => offCurve(design, [x, y], angle), 0, 2 * Math.PI, samples, true)) {
    const start = candidate(design, [x, y], psi), starts = [start.q];
    // Where the curve crosses itself, one alpha_1 has two alpha_2.
    if (Math.abs(start.u) < 1e-3 * design.l ** 2)
      for (let k = 0; k < 12; k++) starts.push([start.q[0], FULL_TURN * (k / 12 - 0.5)]);
    for (const q of starts) {
      if (Math.abs(q[0]) > design.joint_limit + 0.1) continue;
      const solution = newton(at, q, [x, y], 0.3), angles = solution.q.map(a => wrapped(a, FULL_TURN));
      if (solution.error > 1e-12 * reach || Math.max(...angles.map(Math.abs)) > limit) continue;
      const gap = (a, b) => Math.abs(wrapped(a - b, FULL_TURN));
      if (!found.some(p => gap(p[0], angles[0]) + gap(p[1], angles[1]) < 1e-6)) found.push(angles);
    }
  }
  return found.sort((p, q) => p[0] - q[0] || p[1] - q[1]);
}

const isHeld = state => state.stability > 0 && state.wrench >= 0;

const MECHANISM = {
  solve({design, load, target}) {
    return inverse(design, target, 256).map(q => {
      const state = posture(design, q, load);
      const label = q.map(a => Math.abs(a) < Math.PI ? "U" : "D").join("");
      return {q, label, usable: isHeld(state), nodes: nodes(design, q), ...state,
              values: [...q, state.determinant, state.stability, state.wrench, ...state.tensions]};
    });
  },
  classOf({design, load, target}) {
    const all = inverse(design, target, 96), held = all.filter(q => isHeld(posture(design, q, load))).length;
    return held ? Math.min(held, 4) + 1 : all.length ? 1 : 0;
  },
  second: {
    cell: ({design, load}, q) => {
      const state = posture(design, q, load);
      return isHeld(state) ? 2 : state.stability > 0 ? 1 : 0;
    },
    classes: ["#ffffff", "#eef1f4", "#cfe3d4"],
    points: solution => solution.q,
    pick: ({design}, q) => ({target: place(design, q).tip}),
  },
};
