// The planar 4-bar: for each of two places of C and both directions of bar DE, the balance of F is a function of alpha.
function states(design, load, target, folds, samples) {
  const found = [], step = Math.PI / samples;
  for (const sign of [1, -1]) {
    const support = supportOf(design, target, sign, load);
    if (!support.exists) continue;
    for (const fold of folds) {
      const f = alpha => balance(design, support.bar, alpha, fold);
      for (const alpha of rootsOf(f, -2 * step, Math.PI + 2 * step, samples + 4, false)) {
        if (alpha < -1e-9 || alpha > Math.PI + 1e-9) continue;
        const state = stateOf(design, support, Math.min(Math.max(alpha, 0), Math.PI), fold, load);
        if (state.distance > 1e-9 * design.length) found.push({...state, rho1: support.rho1, fold});
      }
    }
  }
  return found.sort((p, q) => p.lengths[0] - q.lengths[0] || p.lengths[1] - q.lengths[1]);
}

const MECHANISM = {
  solve({design, load, target}) {
    return states(design, load, target, [1, -1], 180).map(state => ({
      ...state, label: state.stability > 0 ? "stable" : "unstable", usable: state.stability > 0,
      values: [...state.lengths, ...state.q, state.determinant, state.stability, ...state.thrusts],
    }));
  },
  classOf({design, load, target}) {
    const all = states(design, load, target, [1], 60), stable = all.filter(state => state.stability > 0).length;
    return stable ? Math.min(stable, 4) + 1 : all.length ? 1 : 0;
  },
  second: {
    cell: ({design}, lengths) => flatness(design, lengths) > 0 ? 1 : 0,
    classes: ["#eef1f4", "#cfe3d4"],
    points: state => state.lengths,
  },
};
