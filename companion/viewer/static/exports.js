// Files to save: the picture as PNG, walls and trail as glTF.

/** Offers a file for saving. */
export function save(blob, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

/** glTF 2.0 with walls (triangles with colours) and a trail (line strip); flat points x, y, z in metres, y up. */
export function gltf(walls, colors, trail, name) {
  const parts = [], views = [], accessors = [];
  let size = 0;
  const add = (values, bounds) => {
    const data = new Float32Array(values), n = data.length / 3;
    views.push({ buffer: 0, byteOffset: size, byteLength: data.byteLength, target: 34962 });
    const range = (pick, start) => [0, 1, 2].map((k) => {
      let found = start;
      for (let i = k; i < data.length; i += 3) found = pick(found, data[i]);
      return found;
    });
    accessors.push({ bufferView: views.length - 1, componentType: 5126, count: n, type: "VEC3",
      ...(bounds ? { min: range(Math.min, Infinity), max: range(Math.max, -Infinity) } : {}) });
    parts.push(new Uint8Array(data.buffer));
    size += data.byteLength;
    return accessors.length - 1;
  };
  const meshes = [], material = (color) => ({ doubleSided: true, pbrMetallicRoughness: { baseColorFactor: color, metallicFactor: 0, roughnessFactor: 1 } });
  if (walls.length) {
    meshes.push({ name, primitives: [{ attributes: { POSITION: add(walls, true), COLOR_0: add(colors, false) }, mode: 4, material: 0 }] });
  }
  if (trail.length > 3) meshes.push({ name: "trail", primitives: [{ attributes: { POSITION: add(trail, true) }, mode: 3, material: 1 }] });
  const bytes = new Uint8Array(size);
  let at = 0;
  for (const part of parts) { bytes.set(part, at); at += part.length; }
  let text = "";
  for (let i = 0; i < bytes.length; i += 8192) text += String.fromCharCode(...bytes.subarray(i, i + 8192));
  const content = { asset: { version: "2.0", generator: "osape-companion" }, scene: 0, scenes: [{ nodes: meshes.map((_, k) => k) }],
    materials: [material([1, 1, 1, 1]), material([1, 0.84, 0.31, 1])] };
  if (meshes.length) Object.assign(content, { nodes: meshes.map((mesh, k) => ({ name: mesh.name, mesh: k })), meshes,
    buffers: [{ byteLength: size, uri: `data:application/octet-stream;base64,${btoa(text)}` }], bufferViews: views, accessors });
  else content.scenes = [{ name: "empty" }];
  return JSON.stringify(content);
}
