// The arm of three dual-triangles: one angle is free, the other two follow from it in closed form, for two elbows.
function configurations(design, target, q1) {
  const {stretch, folding, elbows} = lastTwo(design, target, q1);
  return stretch < 0 || folding < 0 ? [] : elbows.map(q => q.map(a => wrapped(a, 2 * Math.PI)));
}
const isHeld = state => state.stability > 0 && state.limit >= 0 && state.length >= 0;

const MECHANISM = {
  solve({design, load, extra, target}) {
    return configurations(design, target, extra.q1).map((q, k) => {
      const state = posture(design, q, load);
      return {q, label: k ? "elbow −" : "elbow +", usable: isHeld(state), nodes: nodes(design, q), ...state,
              values: [...q, state.determinant, state.stability, state.limit, ...state.control.map(d => 1000 * d), 1000 * state.length]};
    });
  },
  classOf({design, load, target}) {
    let best = 0;
    for (let k = -32; k <= 32 && best < 2; k++)
      for (const q of configurations(design, target, CONSTANTS.limit * k / 32)) {
        const state = posture(design, q, load);
        best = Math.max(best, isHeld(state) ? 2 : state.limit >= 0 ? 1 : 0);
      }
    return best;
  },
  second: {
    points: solution => [solution.q[0], solution.stability],
    pick: (_, [q1]) => ({extra: {q1: Math.min(Math.max(q1, -CONSTANTS.limit), CONSTANTS.limit)}}),
    // The margin of both elbows over the free angle, dashed where another condition does not hold.
    curves({design, load, target}) {
      const lines = [];
      for (const k of [0, 1]) {
        let line = null;
        for (let n = -200; n <= 200; n++) {
          const q = configurations(design, target, CONSTANTS.limit * n / 200)[k];
          const state = q && posture(design, q, load), dashed = state && !(state.limit >= 0 && state.length >= 0);
          if (!state) { line = null; continue; }
          if (!line || line.dashed !== dashed) lines.push(line = {k, dashed, points: line ? [line.points.at(-1)] : []});
          line.points.push([q[0], state.stability]);
        }
      }
      return lines;
    },
  },
};
