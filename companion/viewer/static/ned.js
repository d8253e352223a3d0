// Drawings in ned that change seldom: the merged world and the obstacles of other vehicles. Both are made once for many frames
// and moved to the position of the frame.

import * as THREE from "three";
import { geometryOf } from "viewer/geometry";
import * as model from "viewer/model";

export const WORLD = 0xe0c080;
const TEAM = [0xe573c7, 0x4dd0e1, 0xffb74d, 0xaed581, 0x9fa8da, 0xff8a65];

/** Colour of a vehicle of the team. */
export function teamColor(vehicle) {
  return TEAM[vehicle % TEAM.length];
}

/** A colour 0xrrggbb as in CSS. */
export function cssColor(color) {
  return `#${color.toString(16).padStart(6, "0")}`;
}

export class NedGroup {
  /** scene: to which it adds its objects; labels: makes text. */
  constructor(scene, labels) {
    this.labels = labels;
    [this.world, this.team] = [new THREE.Group(), new THREE.Group()];
    scene.add(this.world, this.team);
  }

  /** Replaces the merged world; planes: whole centimetres of ned, six numbers each. */
  setWorld(planes) {
    empty(this.world);
    if (planes.length) this.world.add(...walls(quads(planes), WORLD, 0.04, 0.2));
  }

  /** Replaces the obstacles of other vehicles; team: of an answer of the server. */
  setTeam(team) {
    empty(this.team);
    for (const vehicle of new Set(team.sender)) {
      const planes = team.sender.flatMap((sender, k) => (sender === vehicle ? team.planes.slice(6 * k, 6 * k + 6) : []));
      this.team.add(...walls(quads(planes), teamColor(vehicle), 0.16, 0.6));
    }
    for (const mover of team.movers) this.#mover(mover);
  }

  #mover({ sender, name, box, to }) {
    const [x, y, z, hx, hy, hz] = box, color = teamColor(sender), edges = [];
    for (const [i, j] of [[1, 1], [1, -1], [-1, -1], [-1, 1]]) {
      const [u, v] = [j, -i]; // the next corner
      for (const side of [-1, 1]) edges.push([x + i * hx, y + j * hy, z + side * hz], [x + u * hx, y + v * hy, z + side * hz]);
      edges.push([x + i * hx, y + j * hy, z - hz], [x + i * hx, y + j * hy, z + hz]);
    }
    edges.push([x, y, z], to);
    const drawn = (p) => model.toDrawing(p.map((cm) => cm / 100));
    this.team.add(lines(edges.map(drawn), color, 0.95));
    this.team.add(this.labels.sprite(name, drawn([x, y, z - hz - 30]), cssColor(color), 0.024));
  }

  /** Moves all to the position of the frame; hidden for a frame without a position. */
  place(frame, show) {
    const level = show.world !== "ned", yaw = level ? frame.heading : 0;
    this.world.visible = Boolean(show.merged && frame.pos);
    this.team.visible = Boolean(show.team && frame.pos);
    if (!frame.pos) return;
    const [x, y, z] = level ? model.toDrawing(frame.pos) : [0, 0, 0], c = Math.cos(yaw), s = Math.sin(yaw);
    for (const group of [this.world, this.team]) {
      group.rotation.y = yaw;
      group.position.set(-(c * x + s * z), -y, s * x - c * z);
    }
  }
}

function empty(group) {
  for (const o of group.children) {
    if (!o.isSprite) o.geometry.dispose(); // all sprites share one
    o.material.dispose();
  }
  group.clear();
}

/** Planes in whole centimetres of ned, six numbers each, as lists of four corners in the drawing. */
function quads(planes) {
  return Array.from({ length: planes.length / 6 }, (_, k) => model.corners(model.planeAt(planes, k)).map(model.toDrawing));
}

/** Faces and edges of quads. */
function walls(corners, color, faceOpacity, edgeOpacity) {
  const faces = new THREE.Mesh(geometryOf(corners.flatMap(([a, b, c, d]) => [a, b, c, a, c, d])),
    new THREE.MeshBasicMaterial({ color, transparent: true, depthWrite: false, opacity: faceOpacity, side: THREE.DoubleSide }));
  return [faces, lines(corners.flatMap(([a, b, c, d]) => [a, b, b, c, c, d, d, a]), color, edgeOpacity)];
}

function lines(points, color, opacity) {
  return new THREE.LineSegments(geometryOf(points), new THREE.LineBasicMaterial({ color, transparent: true, depthWrite: false, opacity }));
}
