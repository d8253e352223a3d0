// Positions and colours as three.js takes them.

import * as THREE from "three";

/** points: [[x, y, z], ...]; colors: [[r, g, b], ...], one for each point, or nothing. */
export function geometryOf(points, colors) {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.Float32BufferAttribute(points.flat(), 3));
  if (colors) geometry.setAttribute("color", new THREE.Float32BufferAttribute(colors.flat(), 3));
  return geometry;
}
