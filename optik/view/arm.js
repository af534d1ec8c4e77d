"use strict";
// Numbers of the page: the arm's forward kinematics and the state of a motion at any time. Lengths in m, angles in rad.

const Arm = (() => {
  const bytes = text => Uint8Array.from(atob(text), c => c.charCodeAt(0)).buffer;
  /** Decode an array of 64-bit floats from base64. */
  const numbers = text => new Float64Array(bytes(text));
  /** Decode rows of 16-bit integers from base64, each column with its own unit. */
  const scaled = ({ scale, values }) => Float64Array.from(new Int16Array(bytes(values)), (v, k) => v * scale[k % scale.length]);

  /** Product of two poses, 16 numbers each, row after row. */
  const times = (a, b) => {
    const out = new Float64Array(16);
    for (let r = 0; r < 4; r++) for (let c = 0; c < 4; c++)
      for (let k = 0; k < 4; k++) out[4 * r + c] += a[4 * r + k] * b[4 * k + c];
    return out;
  };

  /** A point of a frame in the base frame. */
  const moved = (T, p) => [0, 1, 2].map(r => T[4 * r] * p[0] + T[4 * r + 1] * p[1] + T[4 * r + 2] * p[2] + T[4 * r + 3]);
  const origin = T => [T[3], T[7], T[11]];
  const axis = (T, k) => [T[k], T[4 + k], T[8 + k]];
  const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
  const plus = (a, b, s = 1) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const length = a => Math.hypot(...a);
  const unit = a => a.map(v => v / length(a));

  /** The motion of one joint about or along its z axis, as a pose. */
  const joint = (q, slides) => {
    const c = slides ? 1 : Math.cos(q), s = slides ? 0 : Math.sin(q);
    return [c, -s, 0, 0, s, c, 0, 0, 0, 0, 1, slides ? q : 0, 0, 0, 0, 1];
  };

  /** What an arm is, from the page's data. */
  const made = data => {
    const fixed = numbers(data.fixed), tool = numbers(data.tool), n = data.slides.length;

    /** The values of the axes, or their rates, which follow the joints of a linkage. */
    const axes = (q, rates) => {
      if (!data.follow) return q;
      const [joint, factor, offset] = data.follow;
      return joint.map((j, i) => factor[i] * q[j] + (rates ? 0 : offset[i]));
    };

    /** Poses of the base, of every joint frame and, last, of the tool: n + 2 of them. */
    const frames = q => {
      const out = [Float64Array.of(1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1)], x = axes(q, false);
      for (let i = 0; i < n; i++)
        out.push(times(times(out[i], fixed.subarray(16 * i, 16 * i + 16)), joint(x[i], data.slides[i])));
      out.push(times(out[n], tool));
      return out;
    };

    /** Velocity of the tool's point [m/s]. */
    const velocity = (poses, dq) => {
      let v = [0, 0, 0];
      const dx = axes(dq, true);
      const p = origin(poses[n + 1]);
      for (let i = 0; i < n; i++) {
        const z = axis(poses[i + 1], 2);
        v = plus(v, data.slides[i] ? z : cross(z, minus(p, origin(poses[i + 1]))), dx[i]);
      }
      return v;
    };
    return { n, joints: data.joints.length, frames, velocity, tool: q => origin(frames(q)[n + 1]) };
  };

  /** A motion: its configuration and velocities at any time, by cubics between its instants; at rest outside of them. */
  const track = (data, n) => {
    const t = numbers(data.t), q = numbers(data.q), dq = numbers(data.dq), last = t.length - 1;
    const row = (values, k) => values.subarray(n * k, n * k + n);
    const columns = { q, dq };
    for (const name of ["ddq", "jerk", "torque", "clearance"]) if (data[name]) columns[name] = scaled(data[name]);

    /** The last instant that is not after a time, and the fraction of the way to the next one. */
    const place = time => {
      if (!(time > t[0])) return [0, 0];
      if (time >= t[last]) return [last, 0];
      let low = 0, high = last; // t[low] <= time < t[high]
      while (high - low > 1) {
        const k = (low + high) >> 1;
        if (t[k] <= time) low = k; else high = k;
      }
      return [low, (time - t[low]) / (t[high] - t[low])];
    };
    const at = time => {
      const [k, u] = place(time);
      if (!u) return { q: [...row(q, k)], dq: time > t[last] ? Array(n).fill(0) : [...row(dq, k)] };
      const h = t[k + 1] - t[k], out = { q: [], dq: [] };
      for (let i = n * k; i < n * k + n; i++) {
        const a = q[i], b = q[i + n], va = h * dq[i], vb = h * dq[i + n];
        const c = 3 * (b - a) - 2 * va - vb, d = 2 * (a - b) + va + vb;
        out.q.push(a + u * (va + u * (c + u * d)));
        out.dq.push((va + u * (2 * c + 3 * u * d)) / h);
      }
      return out;
    };

    /** The values of a quantity at a time, by straight lines between the instants; null if the motion lacks it. */
    const values = (name, time) => {
      const all = columns[name], width = all && all.length / t.length, [k, u] = place(time);
      return all ? Array.from({ length: width }, (_, i) =>
        all[width * k + i] + (u ? u * (all[width * (k + 1) + i] - all[width * k + i]) : 0)) : null;
    };

    /** The nearest pair of shapes of each kind at a time. */
    const nearest = time => {
      const [k] = place(time);
      return (data.nearest || []).map(changes => changes.findLast(([first]) => first <= k)[1]);
    };
    return { t, columns, at, values, nearest, end: t[last], count: t.length, configuration: k => row(q, k) };
  };

  return { numbers, made, track, moved, origin, axis, minus, plus, cross, dot, length, unit };
})();
