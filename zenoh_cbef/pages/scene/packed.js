// Scenes as the package packs them (zenoh_cbef/pages/packing.py): JSON, and arrays of numbers.

/** The JSON with its arrays by name. */
export function unpacked(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const told = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  let at = 4 + length;
  const arrays = {};
  for (const [name, shape] of told.arrays) {
    const size = shape.reduce((product, one) => product * one, 1);
    arrays[name] = new Float32Array(buffer, at, size);
    at += 4 * size;
  }
  return { ...told, arrays };
}
