// Measuring between two points that are picked on walls or on the ground.

import * as THREE from "three";
import { geometryOf } from "viewer/geometry";

/** {total, level, height} in metres of two points of the drawing (right, up, backward). */
export function distances(a, b) {
  const [x, y, z] = [0, 1, 2].map((k) => b[k] - a[k]);
  return { total: Math.hypot(x, y, z), level: Math.hypot(x, z), height: y };
}

export function distanceWords({ total, level, height }) {
  return `${total.toFixed(2)} m; level ${level.toFixed(2)} m, height ${height >= 0 ? "+" : "−"}${Math.abs(height).toFixed(2)} m`;
}

export class Measure {
  constructor(scene) {
    this.group = new THREE.Group();
    scene.add(this.group);
    this.points = [];
    this.on = false;
  }

  /** Starts, or ends and removes the line. */
  toggle() {
    this.on = !this.on;
    this.clear();
    return this.on;
  }

  clear() {
    this.points = [];
    for (const o of this.group.children) { o.geometry.dispose(); o.material.dispose(); }
    this.group.clear();
  }

  /** Takes a point of the drawing; the words to show. */
  add(point) {
    if (this.points.length === 2) this.clear();
    this.points.push(point);
    const dot = new THREE.Mesh(new THREE.SphereGeometry(0.06, 12, 8), new THREE.MeshBasicMaterial({ color: 0xff4081, depthTest: false }));
    dot.position.set(...point);
    dot.renderOrder = 9;
    this.group.add(dot);
    if (this.points.length < 2) return "measure: click the second point";
    const line = new THREE.Line(geometryOf(this.points), new THREE.LineBasicMaterial({ color: 0xff4081, depthTest: false }));
    line.renderOrder = 9;
    this.group.add(line);
    return distanceWords(distances(...this.points));
  }
}

/** The picked point [x, y, z]: on a wall, otherwise on a horizontal ground at the height y; null beside both. */
export function pick(ray, walls, y) {
  const [hit] = walls ? ray.intersectObject(walls) : [];
  if (hit) return hit.point.toArray();
  const at = ray.ray.intersectPlane(new THREE.Plane(new THREE.Vector3(0, 1, 0), -y), new THREE.Vector3());
  return at && at.distanceTo(ray.ray.origin) < 200 ? at.toArray() : null;
}
