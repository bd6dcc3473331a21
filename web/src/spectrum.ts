// The amplitude spectrum of a signal, with a Hann window and a fast Fourier transform.

/** Amplitudes [unit of the signal] at frequencies [Hz] of the last 2^k samples. */
export function spectrum(signal: Float64Array, T: number): { f: number[]; amplitude: number[] } {
  const n = 2 ** Math.floor(Math.log2(signal.length));
  const re = new Float64Array(n), im = new Float64Array(n), from = signal.length - n;
  let mean = 0;
  for (let k = 0; k < n; k++) mean += signal[from + k] / n;
  for (let k = 0; k < n; k++) re[k] = (signal[from + k] - mean) * (0.5 - 0.5 * Math.cos((2 * Math.PI * k) / n));
  transform(re, im);
  const f: number[] = [], amplitude: number[] = [];
  for (let k = 2; k < n / 2; k++) {
    f.push(k / (n * T));
    amplitude.push((4 * Math.hypot(re[k], im[k])) / n); // both sides, and a window of mean 1/2
  }
  return { f, amplitude };
}

function transform(re: Float64Array, im: Float64Array): void {
  const n = re.length;
  for (let i = 1, j = 0; i < n; i++) {
    let bit = n >> 1;
    for (; j & bit; bit >>= 1) j ^= bit;
    j ^= bit;
    if (i < j) {
      [re[i], re[j]] = [re[j], re[i]];
      [im[i], im[j]] = [im[j], im[i]];
    }
  }
  for (let length = 2; length <= n; length <<= 1) {
    const angle = (-2 * Math.PI) / length, half = length >> 1;
    for (let k = 0; k < half; k++) {
      const c = Math.cos(angle * k), s = Math.sin(angle * k);
      for (let i = k; i < n; i += length) {
        const a = re[i + half] * c - im[i + half] * s, b = re[i + half] * s + im[i + half] * c;
        re[i + half] = re[i] - a;
        im[i + half] = im[i] - b;
        re[i] += a;
        im[i] += b;
      }
    }
  }
}
