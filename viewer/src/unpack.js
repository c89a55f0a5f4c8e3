// The binary block of the page: zlib, base64; each array as differences of neighbours, split into planes of bytes.
const KINDS = { u8: Uint8Array, u16: Uint16Array, i16: Int16Array, u32: Uint32Array, f32: Float32Array };
const UNSIGNED = { 1: Uint8Array, 2: Uint16Array, 4: Uint32Array };

export async function inflate(text) {
  const packed = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

export function unpack(bytes, { kind, offset, count }) {
  const width = KINDS[kind].BYTES_PER_ELEMENT;
  const whole = new UNSIGNED[width](count);
  let value = 0;
  for (let i = 0; i < count; i++) {
    for (let plane = 0; plane < width; plane++) value += bytes[offset + plane * count + i] * 2 ** (8 * plane);
    whole[i] = value; // a typed array keeps the low bits, which is what the differences are taken in
    value = whole[i];
  }
  return new KINDS[kind](whole.buffer);
}
