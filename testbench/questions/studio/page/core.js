"use strict";
// The computations of the page: plain functions of plain arrays, SI units and radians. Each does what the Python
// function named beside it does; a test in a browser holds them together.
const core = (() => {
  const TIE = 1e-9; // samples; testbench.inputs.multistep
  const PATTERNS = { 3211: [3, -2, 1, -1], 211: [2, -1, 1], 123: [1, -2, 3], doublet: [1, -1], pulse: [1] };

  const zeros = (n, m) => Array.from({ length: n }, () => new Float64Array(m));
  const sampleAt = (t, rate) => Math.floor(t * rate + 0.5 + TIE);

  function multiply(X, Y) {
    const m = Y[0].length, Z = zeros(X.length, m);
    for (let i = 0; i < X.length; i++) for (let k = 0; k < Y.length; k++) {
      const x = X[i][k], row = Y[k], to = Z[i];
      if (x !== 0) for (let j = 0; j < m; j++) to[j] += x * row[j];
    }
    return Z;
  }

  const plus = (X, Y) => X.map((r, i) => r.map((x, j) => x + Y[i][j]));
  const scaled = (X, c) => X.map((r) => Float64Array.from(r, (x) => c * x));

  // exp(M) and its derivatives along every direction: scaling, the Taylor series to the 12th power, squaring, each with
  // the product rule.
  function expm(M, directions) {
    const n = M.length, norm = Math.max(...M.map((r) => r.reduce((s, x) => s + Math.abs(x), 0)));
    const halvings = Math.max(0, Math.ceil(Math.log2(Math.max(norm, 1e-300))) + 2);
    const A = scaled(M, 2 ** -halvings), dA = directions.map((D) => scaled(D, 2 ** -halvings));
    let out = zeros(n, n), term = zeros(n, n), dOut = dA.map(() => zeros(n, n)), dTerm = dA.map(() => zeros(n, n));
    for (let i = 0; i < n; i++) out[i][i] = term[i][i] = 1;
    for (let k = 1; k <= 12; k++) {
      dTerm = dTerm.map((d, p) => scaled(plus(multiply(d, A), multiply(term, dA[p])), 1 / k));
      term = scaled(multiply(term, A), 1 / k);
      out = plus(out, term);
      dOut = dOut.map((d, p) => plus(d, dTerm[p]));
    }
    for (let k = 0; k < halvings; k++) {
      dOut = dOut.map((d) => plus(multiply(d, out), multiply(out, d)));
      out = multiply(out, out);
    }
    return { out, dOut };
  }

  // Discretise [A B] with held input, and its derivatives along E.
  function discretise(A, B, slopes, dt) {
    const n = A.length, F = zeros(n + 1, n + 1);
    for (let i = 0; i < n; i++) { for (let j = 0; j < n; j++) F[i][j] = A[i][j] * dt; F[i][n] = B[i] * dt; }
    const dF = slopes.map((entries) => {
      const D = zeros(n + 1, n + 1);
      entries.forEach(([i, j, v]) => { D[i][j] = v * dt; });
      return D;
    });
    const { out, dOut } = expm(F, dF);
    return { F: out.slice(0, n), dF: dOut.map((D) => D.slice(0, n)), n };
  }

  // Rows of [C D] and their derivatives P E.
  function outputs(C, D, P, slopes) {
    const rows = C.map((r, i) => Float64Array.from([...r, D[i]]));
    const d = slopes.map((entries) => rows.map((_, i) => {
      const row = new Float64Array(C[i].length + 1);
      if (P) P[i].forEach(([, state, weight]) => entries.forEach(([a, j, v]) => { if (a === state) row[j] += weight * v; }));
      return row;
    }));
    return { rows, d };
  }

  const dot = (row, x, u) => { let s = row[x.length] * u; for (let j = 0; j < x.length; j++) s += row[j] * x[j]; return s; };

  // Responses y[i][k] to held samples u and sensitivities s[p][i][k]; testbench.estimators.parametric.response.respond.
  function simulate(model, out, u) {
    const n = model.n, N = u.length, k = model.dF.length;
    let x = new Float64Array(n), next = new Float64Array(n);
    let S = zeros(k, n), nextS = zeros(k, n);
    const y = zeros(out.rows.length, N), s = Array.from({ length: k }, () => zeros(out.rows.length, N));
    for (let t = 0; t < N; t++) {
      const ut = u[t];
      for (let i = 0; i < out.rows.length; i++) {
        y[i][t] = dot(out.rows[i], x, ut);
        for (let p = 0; p < k; p++) s[p][i][t] = dot(out.rows[i], S[p], 0) + dot(out.d[p][i], x, ut);
      }
      for (let i = 0; i < n; i++) {
        next[i] = dot(model.F[i], x, ut);
        for (let p = 0; p < k; p++) nextS[p][i] = dot(model.F[i], S[p], 0) + dot(model.dF[p][i], x, ut);
      }
      [x, next] = [next, x];
      [S, nextS] = [nextS, S];
    }
    return { y, s };
  }

  // What a sensor makes of a signal: scale, first-order lag over straight lines, delay; testbench.sensors.sensor.
  function sensed(signal, sensor, dt) {
    let y = signal.map((v) => v * sensor.scale);
    if (sensor.lag_s > 0) {
      const h = dt / sensor.lag_s, a = Math.exp(-h), mean = -Math.expm1(-h) / h, out = new Float64Array(y.length);
      let last = 0, before = 0; // at rest one sample before the record
      for (let k = 0; k < y.length; k++) { last = a * last + (mean - a) * before + (1 - mean) * y[k]; before = y[k]; out[k] = last; }
      y = out;
    }
    if (sensor.delay_s > 0) {
      const late = sensor.delay_s / dt;
      y = y.map((_, k) => {
        const at = k - late, j = Math.floor(at);
        if (at <= -1) return 0;
        const from = j < 0 ? 0 : y[j], to = j + 1 < y.length ? y[j + 1] : y[y.length - 1];
        return from + (to - from) * (at - j);
      });
    }
    return y;
  }

  // Everything is linear in the input and held inputs are sums of steps: what sensors and views show of a step of one
  // radian at t = 0, computed once, and summed over the jumps of any input.
  function prepare(point, suite, chosen, parameters, duration) {
    const index = parameters.map((name) => point.parameters.indexOf(name)), slopes = index.map((i) => point.E[i]);
    const dt = 1 / suite.rate_hz, N = sampleAt(duration, suite.rate_hz), unit = new Float64Array(N).fill(1);
    const rows = suite.sensors.map((sensor, i) => i).filter((i) => chosen.includes(suite.sensors[i].channel));
    const sensors = rows.map((i) => suite.sensors[i]);
    const model = discretise(point.A, point.B, slopes, dt);
    const seen = outputs(rows.map((i) => suite.C[i]), rows.map((i) => suite.D[i]), rows.map((i) => suite.P[i]), slopes);
    const s = simulate(model, seen, unit).s.map((signals) => signals.map((x, i) => sensed(x, sensors[i], dt)));
    const still = { F: model.F, dF: [], n: model.n };
    const views = simulate(still, outputs(point.views.C, point.views.D, null, []), unit).y;
    return { s, views, sensors, parameters, index, dt, N };
  }

  // The aircraft with derivatives moved by factors of their values (name -> factor, 0.1: a tenth more), and what
  // the sensors then see: A and B are affine in them, C and D follow through the accelerations that sensors feel.
  function moved(point, suite, factors) {
    const n = point.A.length, change = zeros(n, n + 1);
    factors.forEach((factor, name) => {
      const k = point.parameters.indexOf(name);
      point.E[k].forEach(([i, j, v]) => { change[i][j] += v * factor * point.values[k]; });
    });
    const felt = suite.P.map((entries) => {
      const row = new Float64Array(n + 1);
      entries.forEach(([, state, weight]) => change[state].forEach((v, j) => { row[j] += weight * v; }));
      return row;
    });
    return {
      axis: { ...point, A: point.A.map((row, i) => row.map((v, j) => v + change[i][j])), B: point.B.map((v, i) => v + change[i][n]) },
      suite: { ...suite, C: suite.C.map((row, i) => row.map((v, j) => v + felt[i][j])), D: suite.D.map((v, i) => v + felt[i][n]) },
    };
  }

  // Complex transform in place, radix 2; sign -1 forward, +1 back without the factor 1/n.
  function fft(re, im, sign) {
    const n = re.length;
    for (let i = 1, j = 0; i < n; i++) {
      let bit = n >> 1;
      for (; j & bit; bit >>= 1) j ^= bit;
      j ^= bit;
      if (i < j) { [re[i], re[j]] = [re[j], re[i]]; [im[i], im[j]] = [im[j], im[i]]; }
    }
    for (let half = 1; half < n; half *= 2) {
      for (let k = 0; k < half; k++) {
        const c = Math.cos(Math.PI * k / half), s = sign * Math.sin(Math.PI * k / half);
        for (let i = k; i < n; i += 2 * half) {
          const j = i + half, x = re[j] * c - im[j] * s, y = re[j] * s + im[j] * c;
          re[j] = re[i] - x; im[j] = im[i] - y; re[i] += x; im[i] += y;
        }
      }
    }
  }

  // Two signals at a time as one complex one: (a + ib) * u = a * u + i b * u for real u.
  function transforms(signals, size) {
    const out = [];
    for (let i = 0; i < signals.length; i += 2) {
      const re = new Float64Array(size), im = new Float64Array(size);
      re.set(signals[i]);
      if (i + 1 < signals.length) im.set(signals[i + 1]);
      fft(re, im, -1);
      out.push([re, im]);
    }
    return out;
  }

  // Responses to u of all signals that answer a step as given.
  function convolved(prepared, u) {
    const N = prepared.N, jumps = u.map((v, k) => v - (k > 0 ? u[k - 1] : 0));
    const ups = [];
    jumps.forEach((j, k) => { if (j !== 0) ups.push(k); });
    const steps = [...prepared.views, ...prepared.s.flat()];
    if (ups.length <= 12) {
      return steps.map((step) => {
        const y = new Float64Array(N);
        for (const k of ups) { const jump = jumps[k]; for (let t = k; t < N; t++) y[t] += jump * step[t - k]; }
        return y;
      });
    }
    const size = 2 ** Math.ceil(Math.log2(2 * N)), J = transforms([jumps], size)[0], out = [];
    prepared.spectra ??= transforms(steps, size);
    prepared.spectra.forEach(([a, b]) => {
      const re = new Float64Array(size), im = new Float64Array(size);
      for (let k = 0; k < size; k++) {
        re[k] = (a[k] * J[0][k] - b[k] * J[1][k]) / size;
        im[k] = (a[k] * J[1][k] + b[k] * J[0][k]) / size;
      }
      fft(re, im, 1);
      out.push(re.slice(0, N), im.slice(0, N));
    });
    return out.slice(0, steps.length);
  }

  // Responses of the views, and the covariance (null: some direction is not told at all) of the parameters.
  function analyse(prepared, u) {
    const all = convolved(prepared, u), V = prepared.views.length, p = prepared.sensors.length;
    const s = prepared.s.map((_, i) => all.slice(V + i * p, V + (i + 1) * p));
    return { views: all.slice(0, V), covariance: p ? covariance(information(s, prepared.sensors)) : null };
  }

  // Fisher information with unknown offsets projected out; testbench.information.fisher.Experiment.
  function information(s, sensors) {
    const k = s.length, M = zeros(k, k);
    sensors.forEach((sensor, i) => {
      const centred = s.map((sp) => {
        const all = sp[i], c = new Float64Array(Math.ceil(all.length / sensor.every));
        let sum = 0;
        for (let t = 0; t < c.length; t++) { c[t] = all[t * sensor.every]; sum += c[t]; }
        for (let t = 0; t < c.length; t++) c[t] -= sum / c.length;
        return c;
      });
      const weight = sensor.kept / sensor.sigma ** 2;
      for (let p = 0; p < k; p++) for (let q = p; q < k; q++) {
        let sum = 0;
        for (let t = 0; t < centred[p].length; t++) sum += centred[p][t] * centred[q][t];
        M[p][q] += weight * sum;
        if (q > p) M[q][p] = M[p][q];
      }
    });
    return M;
  }

  // Covariance, or null where some direction is not told; scaled Cholesky as in testbench.information.fisher.cost.
  function covariance(M) {
    const k = M.length, size = M.map((r, i) => Math.sqrt(Math.max(r[i], 0)));
    if (!size.every((v) => v > 0)) return null;
    const L = zeros(k, k);
    for (let i = 0; i < k; i++) for (let j = 0; j <= i; j++) {
      let v = M[i][j] / size[i] / size[j];
      for (let a = 0; a < j; a++) v -= L[i][a] * L[j][a];
      if (i === j) { if (!(v > 1e-12)) return null; L[i][i] = Math.sqrt(v); } else L[i][j] = v / L[j][j];
    }
    const inverse = zeros(k, k); // of L
    for (let j = 0; j < k; j++) for (let i = j; i < k; i++) {
      let v = i === j ? 1 : 0;
      for (let a = j; a < i; a++) v -= L[i][a] * inverse[a][j];
      inverse[i][j] = v / L[i][i];
    }
    const out = zeros(k, k);
    for (let i = 0; i < k; i++) for (let j = 0; j < k; j++) {
      let v = 0;
      for (let a = Math.max(i, j); a < k; a++) v += inverse[a][i] * inverse[a][j];
      out[i][j] = v / size[i] / size[j];
    }
    return out;
  }

  // --- inputs ---------------------------------------------------------------------------------------------------------

  function stepped(pattern, step, amplitude, start, N, rate) {
    const u = new Float64Array(N);
    let begin = start;
    for (const p of pattern) {
      const end = begin + Math.abs(p) * step;
      u.fill(Math.sign(p) * amplitude, Math.min(sampleAt(begin, rate), N), Math.min(sampleAt(end, rate), N));
      begin = end;
    }
    return u;
  }

  function swept(f0, f1, T, amplitude, start, N, rate) {
    const u = new Float64Array(N), octaves = Math.log(f1 / f0);
    for (let k = 0; k < N; k++) {
      const tau = Math.round((k - start * rate) * 1e9) / 1e9 / rate;
      if (tau >= 0 && tau < T) u[k] = amplitude * Math.sin(2 * Math.PI * f0 * T / octaves * Math.expm1(octaves * tau / T));
    }
    return u;
  }

  function multisine(lines, phases, period, amplitude, start, N, rate) {
    const n = Math.round(period * rate), one = new Float64Array(n);
    for (let k = 0; k < n; k++) for (let i = 0; i < lines; i++) one[k] += Math.cos(2 * Math.PI * (i + 1) * k / (period * rate) + phases[i]);
    const peak = one.reduce((a, v) => Math.max(a, Math.abs(v)), 0), u = new Float64Array(N), first = sampleAt(start, rate);
    for (let k = 0; k < n && first + k < N; k++) u[first + k] = one[k] * amplitude / peak;
    return u;
  }

  // How long an input lasts after its start, s.
  function length(choice, duration) {
    if (choice.family === "step") return Math.max(duration - choice.start, 0);
    if (choice.family === "sweep" || choice.family === "multisine") return choice.period;
    return choice.step * PATTERNS[choice.family].reduce((a, p) => a + Math.abs(p), 0);
  }

  function input(choice, duration, rate, phases) {
    const N = sampleAt(duration, rate), a = choice.amplitude, start = choice.start;
    if (choice.family === "step") return stepped([1], duration, a, start, N, rate);
    if (choice.family === "sweep") return swept(choice.low, choice.high, choice.period, a, start, N, rate);
    if (choice.family === "multisine") return multisine(choice.lines, phases[choice.lines], choice.period, a, start, N, rate);
    return stepped(PATTERNS[choice.family], choice.step, a, start, N, rate);
  }

  // |U(w)|^2 of held samples; testbench.inputs.signal.energy_spectrum.
  function spectrum(u, dt, omegas) {
    const jumps = [];
    for (let k = 0; k <= u.length; k++) {
      const jump = (k < u.length ? u[k] : 0) - (k > 0 ? u[k - 1] : 0);
      if (jump !== 0) jumps.push([k * dt, jump]);
    }
    return omegas.map((w) => {
      let re = 0, im = 0;
      for (const [t, jump] of jumps) { re += jump * (Math.cos(w * t) - 1); im -= jump * Math.sin(w * t); }
      return (re * re + im * im) / (w * w);
    });
  }

  // testbench.design.spectral_energy.half_power_band
  function band([re, im], duration) {
    const wn = Math.hypot(re, im), half = Math.min(Math.max(Math.abs(re), Math.PI / duration), 0.95 * wn);
    return [wn - half, Math.abs(im) > 1e-9 * wn ? wn + half : wn];
  }

  return { prepare, analyse, moved, input, length, spectrum, band };
})();
