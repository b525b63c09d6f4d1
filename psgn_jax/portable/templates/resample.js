// Resizes images, which are stored row by row with `channels` values per pixel.

const BITS = 22; // fractional bits of Pillow's weights for 8-bit images

const sinc = x => x === 0 ? 1 : Math.sin(Math.PI * x) / (Math.PI * x);
/** A filter's reach in output pixels, and its weight at a distance. */
const BILINEAR = { reach: 1, weight: x => Math.max(0, 1 - Math.abs(x)) };
export const LANCZOS = { reach: 3, weight: x => Math.abs(x) < 3 ? sinc(x) * sinc(x / 3) : 0 };

/** First input pixel and integer weights of every output pixel, as in Pillow, which stores the ends as float32. */
function taps(size, first, last, outSize, { reach, weight }) {
  first = Math.fround(first);
  const scale = Math.fround(Math.fround(last) - first) / outSize, stretch = Math.max(scale, 1), spread = reach * stretch;
  return Array.from({ length: outSize }, (_, i) => {
    const centre = first + (i + 0.5) * scale, low = Math.max(0, Math.trunc(centre - spread + 0.5));
    const high = Math.min(size, Math.trunc(centre + spread + 0.5)), weights = [];
    for (let j = low; j < high; j++) weights.push(weight((j - centre + 0.5) * (1 / stretch)));
    const sum = weights.reduce((a, b) => a + b, 0) || 1;
    return { low, weights: weights.map(w => Math.trunc(w / sum * 2 ** BITS + 0.5 * Math.sign(w))) };
  });
}

/** Resizes the region [left, top, right, bottom] of bytes to outWidth x outHeight, with exactly the results of Pillow's filter. */
export function resize(data, width, height, channels, outWidth, outHeight, [left, top, right, bottom], filter = BILINEAR) {
  // Resizes `count` rows of `size` pixels, and makes columns of them: after two passes they are rows again.
  const pass = (input, size, count, pixels) => {
    const out = new Uint8Array(pixels.length * count * channels);
    for (let row = 0; row < count; row++) pixels.forEach(({ low, weights }, i) => {
      for (let c = 0; c < channels; c++) {
        let sum = 1 << (BITS - 1);
        for (let k = 0, at = (row * size + low) * channels + c; k < weights.length; k++, at += channels) sum += input[at] * weights[k];
        out[(i * count + row) * channels + c] = Math.min(255, Math.max(0, sum >> BITS));
      }
    });
    return out;
  };
  const columns = pass(data, width, height, taps(width, left, right, outWidth, filter));
  return pass(columns, height, outWidth, taps(height, top, bottom, outHeight, filter));
}
