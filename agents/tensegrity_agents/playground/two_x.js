// The 2-X manipulator. Every solution's first joint is a root along the circle of its eccentric anomaly.
const inverse = (design, target, samples) => pairs({
  off: psi => offCurve(design, target, psi), start: psi => candidate(design, target, psi), at: q => place(design, q),
}, target, design, samples);

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
