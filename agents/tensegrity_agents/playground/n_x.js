// Three X-joints: one angle is free, the other two follow from it as those of a 2-X that stands on the first joint.
function configurations(design, target, q1, samples) {
  const seen = beyondFirst(design, target, q1);
  return pairs({
    off: psi => offCurve(design, seen, psi), start: psi => candidate(design, seen, psi), at: q => place(design, q),
  }, seen, design, samples).map(q => [q1, ...q]);
}
const isHeld = state => state.stability > 0 && state.wrench >= 0;

const MECHANISM = {
  solve({design, load, extra, target}) {
    return configurations(design, target, extra.q1, 256).map(q => {
      const state = posture(design, q, load);
      return {q, label: q[1] > q[2] ? "α₂ > α₃" : "α₂ < α₃", usable: isHeld(state), nodes: nodes(design, q), ...state,
              values: [...q, state.determinant, state.stability, state.wrench, ...state.tensions]};
    });
  },
  classOf({design, load, target}) {
    let best = 0;
    if (Math.hypot(...target) > 3 * (design.l + design.a)) return best;
    for (let k = 0; k <= 24 && best < 2; k++) {  // from the middle outwards, to both sides
      const q1 = CONSTANTS.limit / 12 * (k % 2 ? -(k + 1) / 2 : k / 2);
      for (const q of configurations(design, target, q1, 32))
        best = Math.max(best, isHeld(posture(design, q, load)) ? 2 : 1);
    }
    return best;
  },
  second: {
    points: solution => [solution.q[0], solution.stability],
    pick: (_, [q1]) => ({extra: {q1: Math.min(Math.max(q1, -CONSTANTS.limit), CONSTANTS.limit)}}),
    // The margin over the free angle, in the order of the solutions, dashed where tensions leave their limits.
    curves({design, load, target}) {
      const lines = [], open = [];
      for (let n = -100; n <= 100; n++) {
        const all = configurations(design, target, CONSTANTS.limit * n / 100, 64);
        for (let k = 0; k < Math.max(all.length, open.length); k++) {
          if (!all[k]) { open[k] = null; continue; }
          const state = posture(design, all[k], load), dashed = state.wrench < 0, before = open[k];
          if (!before || before.dashed !== dashed)
            lines.push(open[k] = {k, dashed, points: before ? [before.points.at(-1)] : []});
          open[k].points.push([all[k][0], state.stability]);
        }
      }
      return lines;
    },
  },
};
