// Tracked obstacles of a frame: outlines whose brightness is their confidence, ids, and boxes with arrows of what moves.

import * as model from "viewer/model";

export const STATIC = [0.36, 0.83, 1.0], MOVING = [1.0, 0.45, 0.85];
const LABELS = 15;
const metres = (cm) => cm / 100;

/** {lines, colors, labels} in `level`; labels: {text, at, color}. tracks: of frame_data; numbers: whether to label static ones. */
export function trackDrawing(tracks, numbers) {
  const lines = [], colors = [], labels = [], near = [];
  tracks.id.forEach((id, k) => {
    const [a, b, c, d] = model.corners(model.planeAt(tracks.planes, k));
    const light = 0.25 + 0.75 * tracks.confidence[k] / 100, color = (tracks.object[k] ? MOVING : STATIC).map((v) => v * light);
    lines.push(a, b, b, c, c, d, d, a);
    for (let n = 0; n < 8; n++) colors.push(color);
    const middle = [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2, d[2] + 0.15];
    if (!tracks.object[k]) near.push({ far: Math.hypot(middle[0], middle[1]), at: middle, text: `${id}  ${tracks.confidence[k]} %` });
  });
  if (numbers) {
    near.sort((p, q) => p.far - q.far);
    for (const { at, text } of near.slice(0, LABELS)) labels.push({ text, at, color: "#9fdcff" });
  }
  for (const mover of tracks.movers) addMover(mover, lines, colors, labels);
  return { lines, colors, labels };
}

function addMover(mover, lines, colors, labels) {
  const corner = (k, z) => [metres(mover.corners[2 * (k % 4)]), metres(mover.corners[2 * (k % 4) + 1]), metres(z)];
  const [from, to] = [mover.from, mover.to].map((p) => p.map(metres)), edges = [from, to];
  for (let k = 0; k < 4; k++) {
    for (const z of [mover.top, mover.bottom]) edges.push(corner(k, z), corner(k + 1, z));
    edges.push(corner(k, mover.top), corner(k, mover.bottom));
  }
  const [dx, dy] = [to[0] - from[0], to[1] - from[1]], head = 0.2;
  for (const side of [-1, 1]) edges.push(to, [to[0] - head * (dx - side * dy), to[1] - head * (dy + side * dx), to[2]]);
  lines.push(...edges);
  edges.forEach(() => colors.push(MOVING));
  labels.push({ text: mover.text, at: [from[0], from[1], metres(mover.top) - 0.3], color: "#ff8ad8" });
}
