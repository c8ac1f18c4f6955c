// What the page is told, and the run at any time. The Python beside this is mjsheaf/page/page.py.

/** Read the page's two data elements; resolves to a Run. */
export async function readRun() {
  const said = JSON.parse(document.getElementById("said").textContent);
  const packed = Uint8Array.from(atob(document.getElementById("data").textContent.trim()), (c) => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
  return new Run(said, bytes);
}

const UNKNOWN = -(2 ** 31);

/** Undo Packer: byte planes, signs in the lowest bit, differences along time. Shape (samples, columns), row by row. */
function unpack(bytes, { shape: [rows, columns], at, step }) {
  const count = rows * columns;
  const found = new Float32Array(count);
  const bits = new Int32Array(1);
  const asFloat = new Float32Array(bits.buffer);
  for (let c = 0, i = at; c < columns; c++) {
    let sum = 0;
    for (let r = 0; r < rows; r++, i++) {
      const z = bytes[i] | (bytes[i + count] << 8) | (bytes[i + 2 * count] << 16) | (bytes[i + 3 * count] << 24);
      sum = (sum + ((z >>> 1) ^ -(z & 1))) | 0;
      bits[0] = sum;
      found[r * columns + c] = step ? (sum === UNKNOWN ? NaN : sum * step) : asFloat[0];
    }
  }
  return found;
}

/**
 * A run.
 *
 * said: what Python said (mjsheaf/page/page.py); time: of the K samples; agents, vehicles: N and V.
 * series: values over time by name, Float32Array of K rows; distances in m, speeds in m/s.
 */
export class Run {
  constructor(said, bytes) {
    this.said = said;
    this.time = Float64Array.from(said.time);
    this.agents = said.agents.length;
    this.names = [...said.agents, ...said.targets];
    this.vehicles = this.names.length;
    this.series = {};
    for (const [name, entry] of Object.entries(said.arrays)) this.series[name] = unpack(bytes, entry);
    this.columns = (name) => said.arrays[name].shape[1];
    this.start = this.time[0];
    this.end = this.time[this.time.length - 1];
    this.events = said.phases.filter((phase) => phase.events.length);
    this.groupOf = said.group;
  }

  /** The largest speed that the law may ask of an agent at a sample, m/s; null for none, and for who is not there. */
  limit(k, agent) {
    return this.said.limits.findLast(({ time }, n) => n === 0 || time <= this.time[k] + 1e-9).limit[agent];
  }

  /** The largest speed that an agent can make and may be asked for at a sample, m/s; null for none. */
  most(k, agent) {
    const known = [this.said.fastest[agent], this.limit(k, agent)].filter((x) => x !== null && Number.isFinite(x));
    return known.length ? Math.min(...known) : null;
  }

  /** The sample at or before a time, and how far it is to the next one, 0 to 1. */
  locate(t) {
    const { time } = this;
    let low = 0;
    let high = time.length - 1;
    if (t >= time[high]) return [high, 0];
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (time[middle] <= t) low = middle;
      else high = middle;
    }
    return [low, Math.max(0, (t - time[low]) / (time[high] - time[low]))];
  }

  /** Interpolate columns [first, first + count) of a series at a time, into `out`. */
  at(name, t, out, first = 0, count = this.columns(name)) {
    const [k, share] = this.locate(t);
    const values = this.series[name];
    const width = this.columns(name);
    const a = k * width + first;
    const b = share > 0 ? a + width : a;
    for (let i = 0; i < count; i++) {
      const x = values[a + i];
      const y = values[b + i];
      // What is not known at the one end is held from the other.
      out[i] = share === 0 || Number.isNaN(y) ? x : Number.isNaN(x) ? y : x + share * (y - x);
    }
    return out;
  }

  /** The value of one column at the sample at or before a time. */
  value(name, t, column) {
    return this.series[name][this.locate(t)[0] * this.columns(name) + column];
  }

  /** Whether an agent is part of the team at a sample: lost ones have no error. */
  present(k, agent) {
    return !Number.isNaN(this.series.tracking_error[k * this.agents + agent]);
  }

  /** The name of what the filter keeps an agent from at a sample; "" where it does not act. */
  keptFrom(k, agent) {
    const cause = this.series.cause?.[k * this.agents + agent] ?? 0;
    return cause > this.vehicles ? this.said.obstacles[cause - this.vehicles - 1].id : (this.names[cause - 1] ?? "");
  }

  /** One column of a series over time. */
  column(name, c) {
    const values = this.series[name];
    const width = this.columns(name);
    const found = new Array(this.time.length);
    for (let k = 0; k < found.length; k++) {
      const x = values[k * width + c];
      found[k] = Number.isFinite(x) ? x : null;
    }
    return found;
  }

  /** Over some agents, at every sample: "mean", "rms", or a quantile of 0 to 1. */
  over(name, agents, how) {
    const values = this.series[name];
    const width = this.columns(name);
    const found = new Array(this.time.length);
    const own = [];
    for (let k = 0; k < found.length; k++) {
      own.length = 0;
      for (const i of agents) {
        const x = values[k * width + i];
        if (Number.isFinite(x)) own.push(x);
      }
      if (!own.length) found[k] = null;
      else if (how === "mean") found[k] = own.reduce((sum, x) => sum + x, 0) / own.length;
      else if (how === "rms") found[k] = Math.sqrt(own.reduce((sum, x) => sum + x * x, 0) / own.length);
      else found[k] = own.sort((a, b) => a - b)[Math.round(how * (own.length - 1))];
    }
    return found;
  }

  /** The agent that is farthest from its place at a sample; -1 where none is known. */
  worst(k) {
    let found = -1;
    let most = -1;
    for (let i = 0; i < this.agents; i++) {
      const x = this.series.tracking_error[k * this.agents + i];
      if (x > most) [found, most] = [i, x];
    }
    return found;
  }
}

/** Whether a link whose residual is this hears nothing: silent ones have a minus sign, zero among them. */
export function isSilent(residual) {
  return residual < 0 || Object.is(residual, -0);
}

/** Three significant digits, as a person reads them. */
export function digits(x) {
  if (x === null || x === undefined || Number.isNaN(x)) return "–";
  if (!Number.isFinite(x)) return x > 0 ? "∞" : "−∞";
  const size = Math.abs(x);
  if (size === 0) return "0";
  if (size >= 1e5 || size < 1e-3) return x.toExponential(1).replace("-", "−");
  return x.toFixed(Math.max(0, 2 - Math.floor(Math.log10(size)))).replace("-", "−");
}

/** A group's colour as a line that can be told from a light or a dark ground. */
export function legible(code, dark) {
  const [r, g, b] = [1, 3, 5].map((at) => parseInt(code.slice(at, at + 2), 16));
  const light = (0.21 * r + 0.72 * g + 0.07 * b) / 255;
  const share = dark ? Math.max(0, 0.42 - light) : Math.max(0, light - 0.66) * 1.6;
  const to = dark ? 255 : 0;
  return `rgb(${[r, g, b].map((x) => Math.round(x + share * (to - x))).join(", ")})`;
}

/** 1, 2 or 5 times a power of ten, at most x. */
export function nice(x) {
  const power = 10 ** Math.floor(Math.log10(x));
  return power * [5, 2, 1].find((step) => step * power <= x * (1 + 1e-9));
}
