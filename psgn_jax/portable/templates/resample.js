// Resizes 8-bit images with exactly the results of Pillow: `resize` (bilinear with antialiasing) and
// `reduce` (averages of blocks). Images are stored row by row, with `channels` bytes per pixel.

const PRECISION = 22; // fractional bits of Pillow's weights for 8-bit images

function weights(size, first, last, outSize) {
  // First input pixel and integer weights of every output pixel. Pillow stores `first` and `last` as
  // float32.
  first = Math.fround(first);
  last = Math.fround(last);
  const scale = Math.fround(last - first) / outSize, spread = Math.max(scale, 1);
  const rows = [];
  for (let i = 0; i < outSize; i++) {
    const centre = first + (i + 0.5) * scale;
    const low = Math.max(0, Math.trunc(centre - spread + 0.5));
    const high = Math.min(size, Math.trunc(centre + spread + 0.5));
    const taps = [];
    let sum = 0;
    for (let j = low; j < high; j++) {
      const weight = Math.max(0, 1 - Math.abs((j - centre + 0.5) * (1 / spread)));
      taps.push(weight);
      sum += weight;
    }
    rows.push({ low, taps: taps.map(w => Math.trunc((sum ? w / sum : w) * 2 ** PRECISION + 0.5)) });
  }
  return rows;
}

const byte = sum => Math.min(255, Math.max(0, sum >> PRECISION));

/** Resizes the region `box` = [left, top, right, bottom] to outWidth x outHeight. */
export function resize(data, width, height, channels, outWidth, outHeight, box) {
  box = box || [0, 0, width, height];
  const across = weights(width, box[0], box[2], outWidth);
  const down = weights(height, box[1], box[3], outHeight);
  const top = down[0].low, bottom = down[outHeight - 1].low + down[outHeight - 1].taps.length;
  const half = 1 << (PRECISION - 1);
  const middle = new Uint8Array(outWidth * (bottom - top) * channels);
  for (let y = top; y < bottom; y++) {
    for (let x = 0; x < outWidth; x++) {
      const { low, taps } = across[x];
      for (let c = 0; c < channels; c++) {
        let sum = half;
        for (let k = 0, at = (y * width + low) * channels + c; k < taps.length; k++, at += channels) {
          sum += data[at] * taps[k];
        }
        middle[((y - top) * outWidth + x) * channels + c] = byte(sum);
      }
    }
  }
  const out = new Uint8Array(outWidth * outHeight * channels), step = outWidth * channels;
  for (let y = 0; y < outHeight; y++) {
    const { low, taps } = down[y];
    for (let i = 0; i < step; i++) {
      let sum = half;
      for (let k = 0, at = (low - top) * step + i; k < taps.length; k++, at += step) {
        sum += middle[at] * taps[k];
      }
      out[y * step + i] = byte(sum);
    }
  }
  return out;
}

/** Averages blocks of `across` x `down` pixels; blocks at the right and bottom may be smaller. */
export function reduce(data, width, height, channels, across, down) {
  const outWidth = Math.ceil(width / across), outHeight = Math.ceil(height / down);
  const out = new Uint8Array(outWidth * outHeight * channels);
  for (let y = 0; y < outHeight; y++) {
    const bottom = Math.min(height, (y + 1) * down);
    for (let x = 0; x < outWidth; x++) {
      const right = Math.min(width, (x + 1) * across);
      const count = (bottom - y * down) * (right - x * across);
      const factor = Math.trunc(2 ** 24 / count);
      for (let c = 0; c < channels; c++) {
        let sum = count >> 1;
        for (let row = y * down; row < bottom; row++) {
          for (let column = x * across; column < right; column++) {
            sum += data[(row * width + column) * channels + c];
          }
        }
        out[(y * outWidth + x) * channels + c] = Math.floor(sum * factor / 2 ** 24);
      }
    }
  }
  return { data: out, width: outWidth, height: outHeight };
}

/** Averages over the areas of the output pixels, for any sizes; returns floats, not bytes. */
export function areaAverage(data, width, height, channels, outWidth, outHeight) {
  const cover = (size, outSize) => Array.from({ length: outSize }, (_, i) => {
    const low = i * size / outSize, high = (i + 1) * size / outSize, taps = [];
    for (let j = Math.floor(low); j < Math.min(size, Math.ceil(high)); j++) {
      taps.push([j, (Math.min(high, j + 1) - Math.max(low, j)) * outSize / size]);
    }
    return taps;
  });
  const across = cover(width, outWidth), down = cover(height, outHeight);
  const out = new Float64Array(outWidth * outHeight * channels);
  for (let y = 0; y < outHeight; y++) {
    for (let x = 0; x < outWidth; x++) {
      for (const [row, wy] of down[y]) {
        for (const [column, wx] of across[x]) {
          for (let c = 0; c < channels; c++) {
            out[(y * outWidth + x) * channels + c] += wy * wx * data[(row * width + column) * channels + c];
          }
        }
      }
    }
  }
  return out;
}
