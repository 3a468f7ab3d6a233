// The spatial prism: the orientation under a force is followed from rest while the force grows, by Newton's method.
function held(design, position, force) {
  let w = [0, 0, 0], part = 0, step = 1;
  while (part < 1) {
    const ahead = Math.min(part + step, 1), load = force.map(f => ahead * f);
    let next = w, size = Infinity;
    for (let n = 0; n < 12 && size > 1e-13; n++) {
      const change = turn(design, position, next, load);
      size = Math.max(...change.map(Math.abs));
      if (!(size < 0.1)) break;
      next = next.map((a, i) => a - change[i]);
    }
    if (size < 1e-9 && next.every((a, i) => Math.abs(a - w[i]) < 0.1)) { w = next; part = ahead; step *= 2; }
    else step = Math.min(step / 2, 0.25);
    if (step < 2 ** -16) return null;
  }
  return state(design, [...position, ...w], force);
}
const isHeld = found => found.stability > 0 && found.wrench > 0;

const MECHANISM = {
  solve({design, load, extra, target}) {
    const q = [...target, extra.z], found = extra.z && held(design, q, load);
    if (!found) return [];
    return [{...found, label: "platform", usable: isHeld(found),
             values: [...found.lengths, found.determinant, found.stability, found.wrench, ...found.forces, ...found.tensions,
                      ...found.q.slice(3)]}];
  },
  classOf({design, load, extra, target}) {
    const found = extra.z && held(design, [...target, extra.z], load);
    return found ? isHeld(found) ? 2 : 1 : 0;
  },
  second: {
    handle: ({target, extra}) => [target[0], extra.z],
    pick: ({target}, [x, z]) => ({target: [x, target[1]], extra: {z: Math.max(z, 0.02)}}),
  },
};
