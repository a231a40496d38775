// Read the data of a plot, written by curve_data.py, and compute differences.
"use strict";
const curves = (() => {
  const unpacked = ({ middle, half, data }) => {
    const bytes = Uint8Array.from(atob(data), (c) => c.charCodeAt(0)),
      view = new DataView(bytes.buffer);
    return Float64Array.from(
      { length: bytes.length / 4 },
      (_, k) => middle + half * view.getFloat32(4 * k, true),
    );
  };
  const numbers = (values) =>
    values.data === undefined ? Float64Array.from(values, (v) => (v === null ? NaN : v)) : unpacked(values);
  const times = (x) =>
    x.count === undefined
      ? numbers(x)
      : Float64Array.from({ length: x.count }, (_, k) => x.first + (k * (x.last - x.first)) / (x.count - 1));

  // null in JSON means NaN.
  function read(data) {
    const lines = data.lines.map((line) => ({
      ...line,
      x: times(line.x),
      y: numbers(line.y),
      base: numbers(line.base ?? []),
    }));
    const band = data.band && {
      ...data.band,
      x: times(data.band.x),
      lower: numbers(data.band.lower),
      upper: numbers(data.band.upper),
      base: numbers(data.band.base ?? []),
    };
    return { ...data, lines, band };
  }

  // Return the data as differences from the base of each curve.
  function difference(data) {
    const less = (values, base) => values.map((v, k) => v - base[k]);
    const lines = data.lines.map((line) => ({ ...line, y: less(line.y, line.base) }));
    const band = data.band && {
      ...data.band,
      lower: less(data.band.lower, data.band.base),
      upper: less(data.band.upper, data.band.base),
    };
    const mark = data.mark && { ...data.mark, y: data.mark.y - (data.mark.base ?? NaN) };
    return {
      ...data,
      lines,
      band,
      mark,
      y: around([...(band ? [band.lower, band.upper] : []), ...lines.map((l) => l.y)], band),
    };
  }

  function thin({ band, y }) {
    // whether the point where the curve leaves the band is invisible
    const widths = band
      ? [...band.upper]
          .map((v, k) => v - band.lower[k])
          .filter(Number.isFinite)
          .sort((a, b) => a - b)
      : [];
    return widths.length > 0 && widths[widths.length >> 1] < 0.03 * (y[1] - y[0]);
  }

  function around(curves, band) {
    // the whole range near the band
    let low = Infinity,
      high = -Infinity,
      least = -Infinity,
      most = Infinity;
    for (const curve of curves)
      for (const v of curve) {
        if (v < low) low = v;
        if (v > high) high = v;
      }
    if (band) {
      let edge = 0;
      for (const curve of [band.lower, band.upper])
        for (const v of curve) if (Math.abs(v) > edge) edge = Math.abs(v);
      if (edge > 0) [least, most] = [-8 * edge, 8 * edge];
    }
    low = Math.max(low, least);
    high = Math.min(high, most);
    const room = 0.05 * (high - low) || 0.05 * Math.abs(high) || 1;
    return Number.isFinite(room) ? [low - room, high + room] : [-1, 1];
  }

  function before(times, x) {
    // the index of the last time that is not later than this
    let low = 0,
      high = times.length;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (times[middle] <= x) low = middle;
      else high = middle;
    }
    return low;
  }

  function nearest(times, x) {
    const k = before(times, x);
    return k + 1 < times.length && times[k + 1] - x < x - times[k] ? k + 1 : k;
  }

  // Return the lowest and the highest value of a curve between two times.
  function extent({ x, y }, start, end) {
    let low = Infinity,
      high = -Infinity;
    for (let k = before(x, start); k < x.length && (k === 0 || x[k - 1] < end); k++) {
      if (y[k] < low) low = y[k];
      if (y[k] > high) high = y[k];
    }
    return [low, high];
  }

  return { read, difference, thin, nearest, extent };
})();
