// The one clock: time, play, speed, loop, and the address's hash.

const SPEEDS = [0.05, 0.1, 0.25, 0.5, 1, 2, 3, 5, 10, 20, 50, 100];
const LONGEST = 40; // s that playing a run takes at first, at most

export class Clock extends EventTarget {
  constructor(run) {
    super();
    this.run = run;
    this.t = run.start;
    this.playing = false;
    this.loop = true;
    const wanted = Math.max(run.said.speed, (run.end - run.start) / LONGEST);
    this.speed = SPEEDS.find((speed) => speed >= wanted * 0.99) ?? SPEEDS[SPEEDS.length - 1];
    this.speeds = SPEEDS;
  }

  /** Go to a time, in s. */
  seek(t) {
    if (Number.isNaN(t)) return;
    this.t = Math.min(Math.max(t, this.run.start), this.run.end);
    this.dispatchEvent(new Event("time"));
  }

  /** Go to the n-th next sample. */
  step(n) {
    const [k, share] = this.run.locate(this.t);
    const from = share > 0 && n < 0 ? k + 1 : k;
    this.pause();
    this.seek(this.run.time[Math.min(Math.max(from + n, 0), this.run.time.length - 1)]);
  }

  play() {
    if (this.run.end <= this.run.start) return;
    if (this.t >= this.run.end) this.seek(this.run.start);
    this.playing = true;
    this.dispatchEvent(new Event("state"));
  }

  pause() {
    this.playing = false;
    this.dispatchEvent(new Event("state"));
  }

  toggle() {
    if (this.playing) this.pause();
    else this.play();
  }

  setSpeed(speed) {
    this.speed = Math.min(Math.max(speed, SPEEDS[0]), SPEEDS[SPEEDS.length - 1]);
    this.dispatchEvent(new Event("state"));
  }

  /** Go slower or faster, by a step. */
  change(step) {
    const near = SPEEDS.reduce((best, s, k) => (Math.abs(s - this.speed) < Math.abs(SPEEDS[best] - this.speed) ? k : best), 0);
    this.setSpeed(SPEEDS[Math.min(Math.max(near + step, 0), SPEEDS.length - 1)]);
  }

  setLoop(loop) {
    this.loop = loop;
    this.dispatchEvent(new Event("state"));
  }

  /** Let so many seconds of the viewer's time pass. */
  advance(seconds) {
    if (!this.playing) return;
    const t = this.t + seconds * this.speed;
    if (t < this.run.end) return this.seek(t);
    if (!this.loop) {
      this.seek(this.run.end);
      return this.pause();
    }
    const span = this.run.end - this.run.start;
    this.seek(this.run.start + ((t - this.run.start) % span));
  }
}

/** What the address's hash says: "#t=12.3&cam=..." as a mapping. */
export function readHash() {
  return Object.fromEntries(new URLSearchParams(location.hash.slice(1)));
}

/** Say it in the address, without a new entry in the history. */
export function writeHash(parts) {
  const hash = "#" + new URLSearchParams(parts).toString().replaceAll("%2C", ",");
  try {
    history.replaceState(null, "", hash);
  } catch {
    // A browser that does not allow this for files: the page works without.
  }
}
