// Computations of the page, without drawing or document. Lengths in metres, angles in radians, z down, unless noted.

export const UNKNOWN = 0, FAR = 255, FIRST = 1, LAST = 254;
export const INFERRED = 1, UNKNOWN_BEHIND = 2, IRREGULAR = 64;
const FLAG_WORDS = [[1, "partly inferred"], [2, "unknown behind"], [4, "cut left"], [8, "cut right"],
  [16, "cut at the top"], [32, "cut at the bottom"], [64, "irregular"]];

/** [r, g, b] 0..1 of a byte of the common scale; palette is one string of 256 rrggbb. */
export function paletteColor(palette, index) {
  const at = 6 * index;
  return [0, 2, 4].map((k) => parseInt(palette.slice(at + k, at + k + 2), 16) / 255);
}

/** The byte 1..254 of a distance; camera has min_m and max_m. */
export function rangeIndex(distance, camera) {
  const share = Math.log(Math.max(distance, 1e-3) / camera.min_m) / Math.log(camera.max_m / camera.min_m);
  return FIRST + Math.round(Math.min(1, Math.max(0, share)) * (LAST - FIRST));
}

/** The distance of a byte 1..254. */
export function indexRange(index, camera) {
  return camera.min_m * Math.pow(camera.max_m / camera.min_m, (index - FIRST) / (LAST - FIRST));
}

/** p_world = Rz(yaw) p_level + t of a frame: {yaw, t}. world "level": the vehicle is the origin, its heading is x.
 *  world "ned" of a frame without position or attitude: drawn at `position`, with `heading`. */
export function worldFromLevel(frame, world, position = [0, 0, 0], heading = 0) {
  if (world !== "ned") return { yaw: 0, t: [0, 0, 0] };
  return { yaw: frame.attitude ? frame.heading : heading, t: frame.pos || position };
}

/** A point of `level` in the world. */
export function toWorld(p, place) {
  const c = Math.cos(place.yaw), s = Math.sin(place.yaw);
  return [c * p[0] - s * p[1] + place.t[0], s * p[0] + c * p[1] + place.t[1], p[2] + place.t[2]];
}

/** A point of the world in `level`. */
export function toLevel(p, place) {
  const c = Math.cos(place.yaw), s = Math.sin(place.yaw);
  const x = p[0] - place.t[0], y = p[1] - place.t[1];
  return [c * x + s * y, -s * x + c * y, p[2] - place.t[2]];
}

/** x forward, y right, z down -> the drawing's right, up, backward. */
export function toDrawing(p) {
  return [p[1], -p[2], -p[0]];
}

/** Horizontal distance from `from` to the nearest point of the segment a -> b. */
export function segmentDistance(ax, ay, bx, by, from = [0, 0]) {
  const dx = bx - ax, dy = by - ay, px = from[0] - ax, py = from[1] - ay;
  const t = Math.min(1, Math.max(0, (px * dx + py * dy) / Math.max(dx * dx + dy * dy, 1e-12)));
  return Math.hypot(px - t * dx, py - t * dy);
}

/** Unit vector to the free side of a -> b: its right seen from above. */
export function freeNormal(ax, ay, bx, by) {
  const dx = bx - ax, dy = by - ay, n = Math.max(Math.hypot(dx, dy), 1e-9);
  return [-dy / n, dx / n];
}

/** Plane k of a flat list of whole centimetres, six of each plane, in metres: {ax, ay, bx, by, top, bottom}. */
export function planeAt(planes, k) {
  const [ax, ay, bx, by, top, bottom] = planes.slice(6 * k, 6 * k + 6).map((cm) => cm / 100);
  return { ax, ay, bx, by, top, bottom };
}

/** The corners [x, y, z] of a plane or wall: above a, above b, below b, below a. */
export function corners({ ax, ay, bx, by, top, bottom }) {
  return [[ax, ay, top], [bx, by, top], [bx, by, bottom], [ax, ay, bottom]];
}

/** The planes of a frame as walls {ax, ay, bx, by, top, bottom, margin, flags, cluster, support, distance}. */
export function planeWalls(frame) {
  const walls = [];
  for (let k = 0; k < frame.flags.length; k++) {
    const plane = planeAt(frame.planes, k);
    walls.push({ ...plane, margin: frame.margin[k] / 100, flags: frame.flags[k], cluster: frame.cluster[k],
      support: frame.support[k], plane: k, distance: segmentDistance(plane.ax, plane.ay, plane.bx, plane.by, frame.cam) });
  }
  return walls;
}

/** The edges of a frame's prisms as walls; an edge takes flags and support of the plane it belongs to. */
export function prismWalls(frame) {
  const walls = [];
  for (const [cluster, top, bottom, closed, margin, xy, planes] of frame.prisms) {
    const m = xy.length / 2, edges = closed ? m : m - 1;
    for (let k = 0; k < edges; k++) {
      const j = (k + 1) % m;
      const [ax, ay, bx, by] = [xy[2 * k], xy[2 * k + 1], xy[2 * j], xy[2 * j + 1]].map((cm) => cm / 100);
      walls.push({ ax, ay, bx, by, top: top / 100, bottom: bottom / 100, margin: margin / 100,
        flags: frame.flags[planes[k]] || 0, cluster, support: frame.support[planes[k]] || 0, plane: planes[k],
        distance: segmentDistance(ax, ay, bx, by, frame.cam) });
    }
  }
  return walls;
}

/** The flags of a wall as text. */
export function flagWords(flags) {
  return FLAG_WORDS.filter(([bit]) => flags & bit).map(([, words]) => words).join(", ") || "fully measured";
}

/** A colour [r, g, b] 0..1 of a wall. by: "distance", "cluster" or "flags". */
export function wallColor(wall, by, camera, palette) {
  if (by === "cluster") return hueColor((wall.cluster * 0.618034) % 1);
  if (by === "flags") {
    if (wall.flags & IRREGULAR) return [0.85, 0.45, 0.95];
    if (wall.flags & INFERRED) return [1.0, 0.75, 0.2];
    return wall.flags & UNKNOWN_BEHIND ? [0.55, 0.75, 1.0] : [0.45, 0.9, 0.5];
  }
  return paletteColor(palette, rangeIndex(wall.distance, camera));
}

function hueColor(hue) {
  const channel = (shift) => 0.45 + 0.5 * Math.min(1, Math.max(0, Math.abs(((hue + shift) % 1) * 6 - 3) - 1));
  return [channel(0), channel(2 / 3), channel(1 / 3)];
}

/** Index of the layer of height that holds z, -1 when none does. Edges increase. */
export function layerAt(edges, z) {
  for (let k = 0; k + 1 < edges.length; k++) if (z >= edges[k] && z < edges[k + 1]) return k;
  return -1;
}

/** Horizontal range up to which a height is clear of the camera's ground in a direction: the ground may rise towards it, and
 *  its tolerance and noise belong to it. down: metres from the camera down to the height. */
export function levelRange(frame, azimuth, down = 0) {
  if (!frame.ground) return Infinity;
  const [below, sx, sy] = frame.ground, [tolerance, noise] = frame.groundMargin, height = below - down;
  if (!(height >= tolerance)) return 0;
  const rise = -sx * Math.cos(azimuth) - sy * Math.sin(azimuth);
  return Math.min(rise > 0 ? (height - tolerance) / rise : Infinity, rise + noise > 0 ? height / (rise + noise) : Infinity);
}

/** Classes of space that are drawn, and what a layer of the free profile holds of each. A further class is one more entry. */
export const SPACES = {
  free: (frame, d, layer) => {
    const [near, far] = freeSpan(frame, d, layer);
    return far > near ? [[near, far]] : [];
  },
  open: (frame, d, layer) => {
    const f = frame.free;
    if (!f.openTo) return [];
    const cell = d * (f.layers.length - 1) + layer, free = f.to[cell] > f.from[cell] ? f.to[cell] : 0;
    const near = Math.max(f.openFrom[cell], free) / 100; // what is free too is drawn as free alone
    const far = Math.min(f.openTo[cell] / 100, groundReach(frame, d, layer));
    return far > near ? [[near, far]] : [];
  },
  unknown: (frame, d, layer, reach) => {
    const quads = [];
    let from = 0;
    for (const [near, far] of [...SPACES.free(frame, d, layer), ...SPACES.open(frame, d, layer)].sort((a, b) => a[0] - b[0])) {
      quads.push([from, Math.min(near, reach)]);
      from = far;
    }
    return [...quads, [from, reach]].filter(([a, b]) => b > a + 0.01);
  },
};

/** [near, far] of the free space of a direction in a layer; far <= near: none. It ends at the ground. */
function freeSpan(frame, d, layer) {
  const f = frame.free, cell = d * (f.layers.length - 1) + layer;
  return [f.from[cell] / 100, Math.min(f.to[cell] / 100, groundReach(frame, d, layer))];
}

/** Distance to the ground in a direction: at the camera's own height in its layer, in others at the middle of the layer, at
 *  which it is drawn. */
function groundReach(frame, d, layer) {
  const f = frame.free, own = layer === layerAt(f.layers, 100 * frame.cam[2]);
  const down = own ? 0 : (f.layers[layer] + f.layers[layer + 1]) / 200 - frame.cam[2];
  return Math.min(...[d, d + 1].map((k) => levelRange(frame, f.azimuth[k] / 1000, down)));
}

/** Corners in `level` of one class of space in one layer, seen from above: [[x, y] x 4, ...], near left, far left, far
 *  right, near right. reach: metres to which unknown space is drawn. */
export function spaceSectors(frame, kind, layer, reach) {
  const f = frame.free, quads = [];
  if (!f || layer < 0) return quads;
  const at = (r, a) => [frame.cam[0] + r * Math.cos(a), frame.cam[1] + r * Math.sin(a)];
  for (let d = 0; d + 1 < f.azimuth.length; d++) {
    const left = f.azimuth[d] / 1000, right = f.azimuth[d + 1] / 1000;
    for (const [near, far] of SPACES[kind](frame, d, layer, reach)) {
      quads.push([at(near, left), at(far, left), at(far, right), at(near, right)]);
    }
  }
  if (kind === "unknown") quads.push(...outside(f.azimuth, at, reach));
  return quads;
}

/** The directions beside the view, in pieces of about 10 degrees: nothing is known there. */
function outside(azimuth, at, reach) {
  const first = azimuth[0] / 1000, last = azimuth[azimuth.length - 1] / 1000, rest = 2 * Math.PI - (last - first);
  const pieces = Math.max(0, Math.ceil(rest / 0.18)), quads = [];
  for (let k = 0; k < pieces; k++) {
    const left = last + (rest * k) / pieces, right = last + (rest * (k + 1)) / pieces;
    quads.push([at(0, left), at(reach, left), at(reach, right), at(0, right)]);
  }
  return quads;
}

/** The layers of a frame: [{layer, z}], z the middle of each in metres of `level`. all: every one, else the camera's. */
export function layersOf(frame, all) {
  const edges = frame.free ? frame.free.layers : [], own = layerAt(edges, 100 * frame.cam[2]);
  if (!all) return own < 0 ? [] : [{ layer: own, z: frame.cam[2] }];
  return edges.slice(1).map((edge, layer) => ({ layer, z: (edges[layer] + edge) / 200 }));
}

/** Heights of a wall above the ground below the camera, or above the camera where no ground is seen: [bottom, top] and what
 *  they count from. */
export function wallHeights(wall, frame) {
  const zero = frame.cam[2] + (frame.ground ? frame.ground[0] : 0);
  return { bottom: zero - wall.bottom, top: zero - wall.top, from: frame.ground ? "ground" : "camera" };
}

/** A point of the image (u, v of the full image, depth Z) in `level`; R row by row, level from optical. */
export function pixelPoint(u, v, depth, camera, frame) {
  const x = ((u - camera.cx) / camera.fx) * depth, y = ((v - camera.cy) / camera.fy) * depth, R = frame.R;
  return [0, 1, 2].map((k) => R[3 * k] * x + R[3 * k + 1] * y + R[3 * k + 2] * depth + frame.cam[k]);
}

/** Pixel [u, v] of a point of `level`, null behind the camera. */
export function projectPixel(p, camera, frame) {
  const d = [0, 1, 2].map((k) => p[k] - frame.cam[k]), R = frame.R;
  const [x, y, z] = [0, 1, 2].map((k) => R[k] * d[0] + R[3 + k] * d[1] + R[6 + k] * d[2]);
  return z < 0.05 ? null : [camera.cx + (camera.fx * x) / z, camera.cy + (camera.fy * y) / z];
}

/** Measured points of a frame in `level`, flat x, y, z, and their bytes. index: bytes of the small image, width w. */
export function depthPoints(index, w, camera, frame) {
  const points = [], bytes = [], h = index.length / w, step = camera.width / w;
  for (let i = 0; i < index.length; i++) {
    if (index[i] < FIRST || index[i] > LAST) continue;
    const u = ((i % w) + 0.5) * step - 0.5, v = (Math.floor(i / w) + 0.5) * (camera.height / h) - 0.5;
    points.push(...pixelPoint(u, v, indexRange(index[i], camera), camera, frame));
    bytes.push(index[i]);
  }
  return { points, bytes };
}

/** The frame to show at a time: the last one whose stamp is not later; frames sorted by t. */
export function frameAt(frames, t) {
  let low = 0, high = frames.length - 1;
  while (low < high) {
    const middle = Math.ceil((low + high) / 2);
    if (frames[middle].t <= t) low = middle; else high = middle - 1;
  }
  return low;
}

/** The next frame in a direction (+1, -1) of the chosen camera (-1: any); stays where there is none. */
export function stepFrame(frames, at, direction, camera) {
  for (let k = at + direction; k >= 0 && k < frames.length; k += direction) {
    if (camera < 0 || frames[k].c === camera) return k;
  }
  return at;
}

/** "3.2 m", "12 m". */
export function metres(x) {
  return (Math.abs(x) < 10 ? x.toFixed(1) : x.toFixed(0)) + " m";
}
