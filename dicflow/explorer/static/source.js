// Manifest and numbers of a result: from texts inside the page, or by fetch from a server.
//
// A source is { manifest, bytes(name), picture(name) }: bytes gives a promise of the Uint8Array of a blob, picture the
// address of a photograph for an <img>. It may have curve(quantity, index), a promise of { values, errors } of a point
// at all steps, null where unknown, which then need not be read for a curve.

/** A source whose blobs stand in the page. texts : name → base64 */
export function inlineSource(manifest, texts) {
  return {
    manifest,
    bytes: async (name) => Uint8Array.from(atob(texts[name]), (letter) => letter.charCodeAt(0)),
    picture: (name) => `data:image/jpeg;base64,${texts[name]}`,
  };
}

/** A source that fetches blobs. address : name → URL; curve : as above, if the server has it */
export function fetchedSource(manifest, address, curve) {
  const bytes = async (name) => {
    const answer = await fetch(address(name));
    if (!answer.ok) throw new Error(`${answer.status} for ${name}`);
    return new Uint8Array(await answer.arrayBuffer());
  };
  return { manifest, bytes, picture: address, curve };
}

async function inflated(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate-raw"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** Codes of one plane after another from their differences along rows; 8 or 16 bits by the number of bytes. */
export function undifferenced(content, rows, cols, planes = 1) {
  const count = rows * cols * planes;
  const wide = content.length === 2 * count;
  const codes = wide ? new Uint16Array(count) : content.slice();
  if (wide) for (let k = 0; k < count; k++) codes[k] = content[k] | (content[count + k] << 8);
  for (let plane = 0; plane < planes; plane++) {
    for (let row = 0; row < rows; row++) {
      const start = (plane * rows + row) * cols;
      if (row) codes[start] += codes[start - cols];
      for (let k = start + 1; k < start + cols; k++) codes[k] += codes[k - 1];
    }
  }
  return codes;
}

const CACHE_BYTES = 256e6;

/** Arrays of a source, the last used of which are kept. */
export class Fields {
  constructor(source) {
    this.source = source;
    this.manifest = source.manifest;
    this.kept = new Map();
    this.size = 0;
  }

  /** Promise of what was made of a blob; made once while it is kept. */
  _made(key, make) {
    const found = this.kept.get(key);
    if (found) {
      this.kept.delete(key);
      this.kept.set(key, found);
      return found.promise;
    }
    const entry = { promise: make(), size: 0 };
    this.kept.set(key, entry);
    entry.promise.then(
      (array) => {
        entry.size = array.byteLength;
        this.size += entry.size;
        for (const [oldest, one] of this.kept) {
          if (this.size <= CACHE_BYTES || one === entry) break;
          this.kept.delete(oldest);
          this.size -= one.size;
        }
      },
      () => this.kept.delete(key),
    );
    return entry.promise;
  }

  /** Promise of the readings of a point at all steps, by a source that gives them. */
  async curve(quantity, index) {
    const number = (value) => (value === null ? NaN : value);
    const { values, errors } = await this._made(`${quantity.name} at ${index}`, async () => {
      const found = await this.source.curve(quantity.name, index);
      return { ...found, byteLength: 16 * found.values.length };
    });
    return { values: values.map(number), errors: errors.map(number) };
  }

  /** Promise of the codes of a step's blob, null where the step has none. */
  codes(step, key) {
    const name = step.blobs[key];
    if (!name) return Promise.resolve(null);
    const planes = key === "place/space" ? 3 : key.startsWith("place/") ? 2 : 1;
    return this._codes(name, step.shape, planes);
  }

  _codes(name, [rows, cols], planes) {
    return this._made(`${name} codes`, async () =>
      undifferenced(await inflated(await this.source.bytes(name)), rows, cols, planes),
    );
  }

  /** Promise of places as x, y, z of one point after another, NaN for unknown ones; null where there are none. */
  places(step, place) {
    const name = step.blobs[`place/${place}`];
    return name ? this._places(name, step.shape, place) : Promise.resolve(null);
  }

  /** The same for the first left photograph. */
  firstPlaces() {
    const { first } = this.manifest;
    return first && first.place ? this._places(first.place, first.shape, "left") : Promise.resolve(null);
  }

  _places(name, shape, place) {
    const scales = this.manifest.places[place];
    return this._made(`${name} places`, async () => {
      const codes = await this._codes(name, shape, scales.length);
      const count = shape[0] * shape[1];
      const found = new Float32Array(3 * count);
      scales.forEach(([low, quantum], part) => {
        for (let k = 0; k < count; k++) {
          const code = codes[part * count + k];
          found[3 * k + part] = code ? low + (code - 1) * quantum : NaN;
        }
      });
      return found;
    });
  }
}

/** Value of a code of a quantity; NaN for an unknown one. */
export function valueOf(quantity, code) {
  return code ? quantity.scale[0] + (code - 1) * quantity.scale[1] : NaN;
}

/** Standard deviation of a code; NaN for an unknown one. scale : low and ratio, null without any */
export function deviationOf(scale, code) {
  return scale && code ? scale[0] * scale[1] ** (code - 1) : NaN;
}
