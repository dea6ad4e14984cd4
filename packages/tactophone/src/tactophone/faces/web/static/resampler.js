// Sound at another rate, in a page: a context opens at the rate of its device, because Firefox refuses any other.

const KERNEL_REACH = 6, ROLL_OFF = 0.99;

const gcd = (a, b) => (b ? gcd(b, a % b) : a);
const sinc = (x) => (x === 0 ? 1 : Math.sin(Math.PI * x) / (Math.PI * x));

/** Sound of one channel at another rate, piece by piece; silence lies before it. */
export class Resampler {
  #kept;
  #first; // input sample at which `#kept` begins
  #returned = 0;

  constructor(rate, wanted) {
    const common = gcd(rate, wanted);
    [this.up, this.down] = [wanted / common, rate / common];
    const cutoff = (Math.min(rate, wanted) * ROLL_OFF) / rate;
    this.reach = rate === wanted ? 0 : Math.ceil(KERNEL_REACH / cutoff);
    this.kernels = Array.from({ length: this.up }, (_, phase) => {
      const weights = Float64Array.from({ length: 2 * this.reach + 1 }, (_, tap) => {
        const place = (tap - this.reach - phase / this.up) * cutoff;
        return Math.abs(place) < KERNEL_REACH ? sinc(place) * Math.cos((place * Math.PI) / 2 / KERNEL_REACH) ** 2 : 0;
      });
      const sum = weights.reduce((total, weight) => total + weight);
      return Float32Array.from(weights, (weight) => weight / sum);
    });
    this.#kept = new Float32Array(this.reach);
    this.#first = -this.reach;
  }

  /** Return the output samples that this sound completes. */
  push(samples) {
    this.#kept = joined(this.#kept, samples);
    const end = this.#first + this.#kept.length - this.reach; // input samples with all around them
    const ready = Math.max(this.#returned, Math.ceil((end * this.up) / this.down));
    const output = new Float32Array(ready - this.#returned);
    for (let n = this.#returned; n < ready; n++) {
      const kernel = this.kernels[(n * this.down) % this.up];
      const start = Math.floor((n * this.down) / this.up) - this.reach - this.#first;
      let sum = 0;
      for (let tap = 0; tap < kernel.length; tap++) sum += kernel[tap] * this.#kept[start + tap];
      output[n - this.#returned] = sum;
    }
    this.#returned = ready;
    const unneeded = Math.max(0, Math.floor((ready * this.down) / this.up) - this.reach - this.#first);
    this.#kept = this.#kept.slice(unneeded);
    this.#first += unneeded;
    return output;
  }
}

export function joined(first, second) {
  const both = new Float32Array(first.length + second.length);
  both.set(first);
  both.set(second, first.length);
  return both;
}
