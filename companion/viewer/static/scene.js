// Draws one frame. All objects are created for each frame. The old ones are disposed of after the new ones have been drawn, so
// that the shader programs, which both use, are not compiled again. Text textures are cached.

import * as THREE from "three";
import { geometryOf } from "viewer/geometry";
import * as model from "viewer/model";
import { Labels } from "viewer/labels";
import { NedGroup } from "viewer/ned";
import { trackDrawing } from "viewer/tracks";

/** Colours that the legend names. */
export const FREE = 0x43c46b, OPEN = 0xe6c619, UNKNOWN = 0x8b97a3, GROUND = 0x9c8570, VEHICLE = 0xf5f7fa;
const VIEW = 0x64a8ff, BLIND = 0xff4136, RINGS = [1, 2, 5, 10, 20];
/** How each class of space is drawn: colour, opacity in one layer, opacity where all layers overlap. */
const SPACE_LOOKS = { free: [FREE, 0.30, 0.13], open: [OPEN, 0.30, 0.13], unknown: [UNKNOWN, 0.22, 0] }, UNKNOWN_REACH_M = 20;

export class FrameScene {
  constructor(data) {
    this.data = data;
    this.scene = new THREE.Scene();
    this.scene.background = new THREE.Color(0x14181d);
    this.group = new THREE.Group();
    this.scene.add(this.group);
    this.walls = null;
    this.faces = { points: [], colors: [] };
    this.trail = [];
    this.gone = [];
    this.labels = new Labels();
    this.ned = new NedGroup(this.scene, this.labels);
  }

  clear() {
    this.gone.push(...this.group.children);
    this.group.clear();
    this.walls = null;
    this.faces = { points: [], colors: [] };
  }

  /** Disposes of objects that are no longer drawn, after their replacements have been drawn. */
  release() {
    for (const o of this.gone) {
      if (!o.isSprite) o.geometry?.dispose(); // all sprites share one
      o.material?.dispose();
    }
    this.gone = [];
    this.labels.release();
  }

  /** Draws a frame. show: what to show and how; index: bytes of the small depth image or null, w: its width. */
  draw(frame, show, place, index, w) {
    this.clear();
    const camera = this.data.cameras[frame.c];
    this.at = (p) => model.toDrawing(model.toWorld(p, place));
    this.ned.place(frame, show);
    this.#vehicle(frame, camera);
    if (show.ground) this.#ground(frame, place);
    if (show.trail) this.#trail(frame, show, place);
    if (frame.status === "BLIND") return;
    if (show.points && index && frame.R) this.#points(frame, camera, index, w);
    if (show.unknown) this.#space(frame, "unknown", false, camera);
    if (show.free) {
      for (const kind of ["free", "open"]) this.#space(frame, kind, show.layers === "all", camera);
    }
    this.#walls(frame, show, camera);
    if (show.tracks && frame.tracks) this.#tracks(frame.tracks, show);
  }

  #add(object) { this.group.add(object); return object; }

  #lines(points, color, dash) {
    if (!points.length) return;
    const plain = typeof color === "number", geometry = geometryOf(points, plain ? null : color);
    const look = { transparent: true, ...(plain ? { color } : { vertexColors: true }) };
    const material = dash ? new THREE.LineDashedMaterial({ ...look, dashSize: dash, gapSize: dash * 0.7 })
      : new THREE.LineBasicMaterial(look);
    const lines = this.#add(new THREE.LineSegments(geometry, material));
    if (dash) lines.computeLineDistances();
    return lines;
  }

  #walls(frame, show, camera) {
    const all = show.what === "planes" ? model.planeWalls(frame) : model.prismWalls(frame);
    const walls = all.filter((wall) => show.inferred || !(wall.flags & model.INFERRED));
    const faces = [], colors = [], solid = [[], []], dashed = [[], []], normals = [];
    for (const wall of walls) {
      const color = model.wallColor(wall, show.by, camera, this.data.palette);
      const [a, b, c, d] = model.corners(wall).map(this.at);
      const [nx, ny] = model.freeNormal(wall.ax, wall.ay, wall.bx, wall.by);
      const shade = 0.72 + 0.28 * Math.abs(nx);
      faces.push(a, b, c, a, c, d);
      for (let k = 0; k < 6; k++) colors.push(color.map((v) => v * shade));
      const edges = wall.flags & model.INFERRED ? dashed : solid;
      edges[0].push(a, b, b, c, c, d, d, a);
      for (let k = 0; k < 8; k++) edges[1].push(color.map((v) => 0.35 + 0.65 * v));
      const middle = [(wall.ax + wall.bx) / 2, (wall.ay + wall.by) / 2, (wall.top + wall.bottom) / 2];
      const reach = Math.max(wall.margin, 0.15);
      normals.push(this.at(middle), this.at([middle[0] + nx * reach, middle[1] + ny * reach, middle[2]]));
    }
    this.shown = walls;
    this.faces = { points: faces.flat(), colors: colors.flat() };
    if (walls.length) {
      this.walls = this.#add(new THREE.Mesh(geometryOf(faces, colors), new THREE.MeshBasicMaterial({
        vertexColors: true, transparent: true, opacity: 0.62, side: THREE.DoubleSide, depthWrite: false })));
    }
    this.#lines(...solid);
    this.#lines(...dashed, 0.18);
    if (show.normals) this.#lines(normals, 0xffffff);
    if (show.labels || show.numbers) this.#labels(all, show, frame);
  }

  #tracks(tracks, show) {
    const { lines, colors, labels } = trackDrawing(tracks, show.numbers);
    this.#lines(lines.map(this.at), colors);
    for (const { text, at, color } of labels) this.#text(text, this.at(at), color, 0.024, 1.25); // above the label of its distance
  }

  #labels(walls, show, frame) {
    const nearest = new Map();
    for (const wall of walls) {
      if (!nearest.has(wall.cluster) || wall.distance < nearest.get(wall.cluster).distance) nearest.set(wall.cluster, wall);
    }
    for (const wall of [...nearest.values()].sort((p, q) => p.distance - q.distance).slice(0, 20)) {
      const at = [(wall.ax + wall.bx) / 2, (wall.ay + wall.by) / 2, wall.top - 0.15];
      const { bottom, top } = model.wallHeights(wall, frame), heights = `#${wall.plane}  ${bottom.toFixed(1)} to ${top.toFixed(1)} m`;
      const words = [show.numbers ? heights : "", show.labels ? model.metres(wall.distance) : ""].filter(Boolean).join("  ·  ");
      this.#text(words, this.at(at), "#ffffff", show.numbers ? 0.024 : 0.030);
    }
  }

  #text(text, at, color, size, rows) { this.#add(this.labels.sprite(text, at, color, size, rows)); }

  /** One class of space as horizontal sheets, in the camera's layer or in all. */
  #space(frame, kind, all, camera) {
    const faces = [], [color, single, many] = SPACE_LOOKS[kind], reach = Math.min(camera.max_m, UNKNOWN_REACH_M);
    for (const { layer, z } of model.layersOf(frame, all)) {
      for (const [a, b, c, d] of model.spaceSectors(frame, kind, layer, reach)) {
        for (const p of [a, b, c, a, c, d]) faces.push(this.at([p[0], p[1], z]));
      }
    }
    if (!faces.length) return;
    this.#add(new THREE.Mesh(geometryOf(faces), new THREE.MeshBasicMaterial({
      color, transparent: true, opacity: all ? many : single, side: THREE.DoubleSide, depthWrite: false })));
  }

  #points(frame, camera, index, w) {
    const { points, bytes } = model.depthPoints(index, w, camera, frame);
    const at = new Float32Array(points.length), colors = new Float32Array(points.length);
    for (let k = 0; k < points.length; k += 3) {
      at.set(this.at([points[k], points[k + 1], points[k + 2]]), k);
      colors.set(model.paletteColor(this.data.palette, bytes[k / 3]), k);
    }
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(at, 3));
    geometry.setAttribute("color", new THREE.BufferAttribute(colors, 3));
    this.#add(new THREE.Points(geometry, new THREE.PointsMaterial({ size: 2, sizeAttenuation: false, vertexColors: true })));
  }

  #ground(frame, place) {
    const seen = frame.ground !== null, reach = 40, lines = [], bold = [];
    const height = (p) => {
      if (!seen) return frame.cam[2];
      const [h, sx, sy] = frame.ground, q = model.toLevel([...p, 0], place);
      return frame.cam[2] + h + sx * (q[0] - frame.cam[0]) + sy * (q[1] - frame.cam[1]);
    };
    const put = (p) => model.toDrawing([p[0], p[1], height(p) + place.t[2]]);
    const middle = place.t.slice(0, 2).map(Math.round);
    for (let k = -reach; k <= reach; k++) {
      for (let from = -reach; from < reach; from += 4) { // short pieces: one that passes behind the viewpoint may not be drawn
        for (const across of [true, false]) {
          const ends = [from, from + 4].map((v) => (across ? [middle[0] + k, middle[1] + v] : [middle[0] + v, middle[1] + k]));
          ((middle[across ? 0 : 1] + k) % 5 === 0 ? bold : lines).push(...ends.map(put));
        }
      }
    }
    for (const [group, opacity] of [[lines, 0.16], [bold, 0.4]]) {
      this.#lines(group, seen ? GROUND : 0x7d8791, seen ? 0 : 0.25).material.opacity = seen ? opacity : opacity / 2;
    }
    for (const r of RINGS) {
      const ring = [], point = (a) => {
        const world = model.toWorld([frame.cam[0] + r * Math.cos(a), frame.cam[1] + r * Math.sin(a), 0], place);
        return put(world);
      };
      for (let k = 0; k < 72; k++) ring.push(point((k * Math.PI) / 36), point(((k + 1) * Math.PI) / 36));
      this.#lines(ring, 0x8fa3b5).material.opacity = 0.6;
      this.#text(`${r} m`, point(0.75), "#b8c7d6", 0.018);
    }
  }

  #vehicle(frame, camera) {
    const arms = [];
    for (const [x, y] of [[0.25, 0.25], [0.25, -0.25]]) arms.push(this.at([x, y, 0]), this.at([-x, -y, 0]));
    arms.push(this.at([0, 0, 0]), this.at([0.5, 0, 0]));
    this.#lines(arms, VEHICLE);
    if (!frame.R) return;
    const eye = this.at(frame.cam), lines = [], corners = [];
    for (const [u, v] of [[0, 0], [1, 0], [1, 1], [0, 1]]) {
      const ray = [u * camera.width - 0.5, v * camera.height - 0.5];
      corners.push(this.at(model.pixelPoint(...ray, 1.2, camera, frame)));
    }
    corners.forEach((p, k) => lines.push(eye, p, p, corners[(k + 1) % 4]));
    this.#lines(lines, frame.status === "BLIND" ? BLIND : VIEW);
  }

  /** The way of the vehicle: all of it in the world, up to this frame from the vehicle. */
  #trail(frame, show, place) {
    const lines = [], { frames } = this.data, ned = show.world === "ned";
    if (!ned && !frame.pos) { this.trail = []; return; }
    const here = { yaw: frame.heading, t: frame.pos };
    const way = (ned ? frames : frames.filter((f) => f.t <= frame.t)).filter((f) => f.pos).map((f) => model.toDrawing(ned ? f.pos : model.toLevel(f.pos, here)));
    for (let k = 0; k + 1 < way.length; k++) lines.push(way[k], way[k + 1]);
    this.trail = way.flat();
    this.#lines(lines, VEHICLE);
  }
}
