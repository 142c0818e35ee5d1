// The grid of points of a step: which cells are whole, which points are lost and where they would lie.

/** Triangles (a, b, c, …) of the cells whose four corners are known. known(k) : whether point k is */
export function wholeCells(rows, cols, known) {
  const found = new Uint32Array(Math.max(0, (rows - 1) * (cols - 1) * 6));
  let length = 0;
  for (let row = 0; row + 1 < rows; row++) {
    for (let k = row * cols; k + 1 < (row + 1) * cols; k++) {
      if (!(known(k) && known(k + 1) && known(k + cols) && known(k + cols + 1))) continue;
      found[length++] = k;
      found[length++] = k + 1;
      found[length++] = k + cols;
      found[length++] = k + 1;
      found[length++] = k + cols + 1;
      found[length++] = k + cols;
    }
  }
  return found.subarray(0, length);
}

/** Places of all points: a lost one moves as the nearest known one of the grid does. first : null if unknown */
export function withEstimates(places, first, rows, cols) {
  if (!first) return places;
  const found = places.slice();
  const count = rows * cols;
  const [shiftX, shiftY] = [new Float32Array(count), new Float32Array(count)];
  let front = [];
  const done = new Uint8Array(count);
  for (let k = 0; k < count; k++) {
    if (places[3 * k] === places[3 * k] && first[3 * k] === first[3 * k]) {
      shiftX[k] = places[3 * k] - first[3 * k];
      shiftY[k] = places[3 * k + 1] - first[3 * k + 1];
      done[k] = 1;
      front.push(k);
    }
  }
  while (front.length && front.length < count) {
    const next = [];
    for (const k of front) {
      const col = k % cols;
      for (const other of [col ? k - 1 : -1, col + 1 < cols ? k + 1 : -1, k - cols, k + cols]) {
        if (other < 0 || other >= count || done[other]) continue;
        done[other] = 1;
        shiftX[other] = shiftX[k];
        shiftY[other] = shiftY[k];
        found[3 * other] = first[3 * other] + shiftX[k];
        found[3 * other + 1] = first[3 * other + 1] + shiftY[k];
        next.push(other);
      }
    }
    front = next;
  }
  return found;
}

/** Cells with a lost corner, each with corners of its own: { positions, values, indices }; values are status codes. */
export function lostCells(places, status, rows, cols) {
  const [positions, values, indices] = [[], [], []];
  for (let row = 0; row + 1 < rows; row++) {
    for (let k = row * cols; k + 1 < (row + 1) * cols; k++) {
      const corners = [k, k + 1, k + cols, k + cols + 1];
      const worst = Math.max(...corners.map((corner) => status[corner]));
      if (worst === 0 || corners.some((corner) => places[3 * corner] !== places[3 * corner])) continue;
      const start = values.length;
      for (const corner of corners) {
        positions.push(places[3 * corner], places[3 * corner + 1], 0);
        values.push(worst);
      }
      indices.push(start, start + 1, start + 2, start + 1, start + 3, start + 2);
    }
  }
  return {
    positions: Float32Array.from(positions),
    values: Uint16Array.from(values),
    indices: Uint32Array.from(indices),
  };
}

/** Median distance of neighbours in a row. */
export function spacing(places, rows, cols) {
  const found = [];
  const stride = Math.max(1, Math.floor((rows * cols) / 2000));
  for (let k = 0; k + 1 < rows * cols; k += stride) {
    if ((k + 1) % cols === 0) continue;
    const apart = Math.hypot(places[3 * k + 3] - places[3 * k], places[3 * k + 4] - places[3 * k + 1]);
    if (apart === apart) found.push(apart);
  }
  return found.sort((one, other) => one - other)[found.length >> 1] || 1;
}
