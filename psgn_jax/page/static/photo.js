// Reads photos: checks a file before decoding it, turns the photo upright and reduces it to a size
// that a phone can process. Error messages are for the visitor.

import { PhotoError } from "./framing.js";

const MAX_BYTES = 80e6, MAX_PIXELS = 100e6, MIN_SIDE = 16;
/** Larger photos are reduced until their longer side has this many pixels. */
export const MAX_SIDE = 1600;

const text = (bytes, from, to) => String.fromCharCode(...bytes.subarray(from, to));

/** Format of a file by its first bytes: "png", "jpeg", ...; "" if it is not an image. */
export function formatOf(bytes) {
  const begin = text(bytes, 0, 16);
  if (begin.startsWith("\x89PNG")) return "png";
  if (begin.startsWith("\xff\xd8\xff")) return "jpeg";
  if (begin.startsWith("GIF8")) return "gif";
  if (begin.startsWith("BM")) return "bmp";
  if (begin.startsWith("RIFF") && begin.slice(8, 12) === "WEBP") return "webp";
  if (begin.startsWith("II*\0") || begin.startsWith("MM\0*")) return "tiff";
  if (begin.slice(4, 8) === "ftyp") {
    const brand = begin.slice(8, 12);
    if (brand.startsWith("avi")) return "avif";
    if (/^(hei|hev|mif1|msf1)/.test(brand)) return "heic";
  }
  const first = text(bytes, 0, Math.min(bytes.length, 1000));
  return /<svg[\s>]/i.test(first) ? "svg" : "";
}

/** [width, height] from a file's header, or null if they are not there. */
export function sizeOf(bytes, format) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  try {
    if (format === "png") return [view.getUint32(16), view.getUint32(20)];
    if (format === "gif") return [view.getUint16(6, true), view.getUint16(8, true)];
    if (format === "bmp") return [Math.abs(view.getInt32(18, true)), Math.abs(view.getInt32(22, true))];
    if (format === "jpeg") return jpegSize(view);
    if (format === "webp") {
      const kind = text(bytes, 12, 16), u24 = at => view.getUint16(at, true) + (view.getUint8(at + 2) << 16);
      if (kind === "VP8X") return [u24(24) + 1, u24(27) + 1];
      if (kind === "VP8 ") return [view.getUint16(26, true) & 0x3fff, view.getUint16(28, true) & 0x3fff];
      const bits = view.getUint32(21, true);
      return [(bits & 0x3fff) + 1, (bits >> 14 & 0x3fff) + 1];
    }
  } catch (error) {
    if (!(error instanceof RangeError)) throw error; // the file ends before the bytes that state its width and height
  }
  return null;
}

function jpegSize(view) {
  for (let at = 2; at + 9 < view.byteLength;) {
    if (view.getUint8(at) !== 0xff) return null;
    const marker = view.getUint8(at + 1);
    if (marker >= 0xc0 && marker <= 0xcf && ![0xc4, 0xc8, 0xcc].includes(marker)) {
      return [view.getUint16(at + 7), view.getUint16(at + 5)];
    }
    at += 2 + view.getUint16(at + 2);
  }
  return null;
}

/** Reads a photo: { rgb, alpha, width, height, bitmap }; alpha is null if the photo is opaque. */
export async function readPhoto(file) {
  if (!file.size) throw new PhotoError("This file is empty.");
  if (file.size > MAX_BYTES) throw new PhotoError(`This file has ${Math.round(file.size / 1e6)} MB; up to ${MAX_BYTES / 1e6} MB can be read.`);
  const bytes = new Uint8Array(await file.arrayBuffer()), format = formatOf(bytes);
  if (format === "svg") throw new PhotoError("SVG drawings cannot be used; save the drawing as PNG or JPEG first.");
  if (!format) throw new PhotoError("This file is not an image; expected a photo such as JPEG, PNG or WebP.");
  const size = sizeOf(bytes, format);
  if (size && size[0] * size[1] > MAX_PIXELS) {
    throw new PhotoError(`This image has ${size[0]} x ${size[1]} pixels; up to ${MAX_PIXELS / 1e6} million can be read.`);
  }
  const blob = new Blob([bytes], { type: `image/${format}` });
  let bitmap = await decode(blob, format);
  const { width, height } = bitmap, longest = Math.max(width, height);
  if (Math.min(width, height) < MIN_SIDE) {
    throw new PhotoError(`This image has ${width} x ${height} pixels; at least ${MIN_SIDE} per side are needed.`);
  }
  if (longest > MAX_SIDE) {
    const scale = MAX_SIDE / longest;
    const smaller = { resizeWidth: Math.max(MIN_SIDE, Math.round(width * scale)), resizeHeight: Math.max(MIN_SIDE, Math.round(height * scale)), resizeQuality: "high" };
    const reduced = await createImageBitmap(bitmap, smaller);
    bitmap.close();
    bitmap = reduced;
  }
  return pixelsOf(bitmap);
}

async function decode(blob, format) {
  try {
    return await createImageBitmap(blob, { imageOrientation: "from-image" });
  } catch {
    if (format === "heic") throw new PhotoError("This browser cannot read HEIC photos; save the photo as JPEG first (on an iPhone: Settings, Camera, Formats, Most Compatible).");
    if (format === "tiff" || format === "avif") throw new PhotoError(`This browser cannot read ${format.toUpperCase()} images; save the image as JPEG or PNG first.`);
    throw new PhotoError("This image is damaged and cannot be decoded.");
  }
}

function pixelsOf(bitmap) {
  const { width, height } = bitmap;
  const canvas = document.createElement("canvas");
  canvas.width = width;
  canvas.height = height;
  const context = canvas.getContext("2d", { willReadFrequently: true });
  if (!context) throw new PhotoError("There is not enough memory for this image.");
  context.drawImage(bitmap, 0, 0);
  const rgba = context.getImageData(0, 0, width, height).data, count = width * height;
  const rgb = new Uint8Array(3 * count), alpha = new Uint8Array(count);
  let opaque = true;
  for (let i = 0; i < count; i++) {
    for (let c = 0; c < 3; c++) rgb[3 * i + c] = rgba[4 * i + c];
    alpha[i] = rgba[4 * i + 3];
    opaque &&= alpha[i] === 255;
  }
  return { rgb, alpha: opaque ? null : alpha, width, height, bitmap };
}
