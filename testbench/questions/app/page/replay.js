// A flight in three dimensions on a canvas: path, attitude and horizon, at the time of the cursor. Own arithmetic, no
// library: some dozens of flat faces and a line need none. What flies is drawn from its own outline. Frame: x north, y east, z down, m; Euler angles 3-2-1.
const unpacked = text => new Float32Array(Uint8Array.from(atob(text), c => c.charCodeAt(0)).buffer);

class Replay {
  constructor(motion, moved) {
    this.m = Object.fromEntries(["t", "phi", "theta", "psi", "north", "east", "up"].map(k => [k, unpacked(motion[k])]));
    this.craft = motion.craft; this.moved = moved; this.k = 0; this.azimuth = 2.5; this.height = 0.5; this.playing = false; this.rate = 1; this.near = true;
    this.box = make("div", { className: "replay" });
    this.canvas = make("canvas", { tabIndex: 0 });
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", "The flight in three dimensions; arrows turn the view, the space bar plays");
    this.says = make("output");
    this.play = press("Play", () => this.toggle());
    const rate = make("select", {}, ...[0.25, 1, 2, 5, 20].map(r => new Option(`${r} ×`, r, r === 1, r === 1)));
    rate.setAttribute("aria-label", "Speed of the replay");
    rate.onchange = () => { this.rate = +rate.value; };
    const near = press("Whole path", b => { this.near = !this.near; b.textContent = this.near ? "Whole path" : "Near"; this.draw(); });
    this.box.append(make("div", { className: "row" }, this.play, rate, near, this.says), this.canvas, make("p", { className: "hint" }, `Drag turns the view. ${motion.craft.name ? `Drawn as ${motion.craft.name} is, its span ${told(motion.craft.span_m)} m; in sight larger than to scale.` : "The aircraft is not known: a usual one is drawn."}${motion.said.length ? ` Not recorded: ${motion.said.join(", ")}.` : ""}`));
    this.canvas.addEventListener("pointerdown", e => { this.canvas.setPointerCapture(e.pointerId); this.last = [e.clientX, e.clientY]; });
    this.canvas.addEventListener("pointermove", e => {
      if (!this.canvas.hasPointerCapture(e.pointerId)) return;
      this.turn((e.clientX - this.last[0]) * 0.01, (e.clientY - this.last[1]) * 0.008); this.last = [e.clientX, e.clientY];
    });
    this.canvas.addEventListener("keydown", e => {
      const way = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.08], ArrowDown: [0, -0.08] }[e.key];
      if (way) this.turn(...way); else if (e.key === " ") this.toggle(); else return;
      e.preventDefault();
    });
    new ResizeObserver(() => this.draw()).observe(this.box);
    const { north, east, up } = this.m, span = v => { let a = Infinity, b = -Infinity; for (const x of v) { if (x < a) a = x; if (x > b) b = x; } return [a, b]; };
    this.ends = [span(north), span(east), span(up)];
    this.ground = this.ends[2][0];
  }
  turn(a, h) { this.azimuth += a; this.height = Math.min(1.5, Math.max(0.02, this.height + h)); this.draw(); }
  toggle() {
    this.playing = !this.playing; this.play.textContent = this.playing ? "Pause" : "Play";
    if (!this.playing) return;
    if (this.k >= this.m.t.length - 1) this.k = 0;
    let then = performance.now(), time = this.m.t[this.k];
    const step = now => {
      if (!this.playing || !this.box.isConnected) return;
      time += this.rate * (now - then) / 1000; then = now;
      this.at(time); this.moved(time);
      if (this.k >= this.m.t.length - 1) this.toggle(); else requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }
  at(time) { // show the last frame before a time, s
    const t = this.m.t;
    let low = 0, high = t.length - 1;
    while (low < high) { const mid = (low + high + 1) >> 1; if (t[mid] <= time) low = mid; else high = mid - 1; }
    this.k = low; this.draw();
  }
  draw() {
    const c = this.canvas, ratio = devicePixelRatio || 1, wide = c.clientWidth, tall = Math.min(420, Math.max(240, wide * 0.45));
    if (!wide) return;
    c.style.height = `${tall}px`; c.width = wide * ratio; c.height = tall * ratio;
    const g = c.getContext("2d"), { m, k } = this;
    g.scale(ratio, ratio);
    const size = Math.max(5, ...this.ends.map(([a, b]) => b - a)), here = [m.north[k], m.east[k], m.up[k]];
    const centre = this.near ? here : this.ends.map(([a, b]) => 0.5 * (a + b)), reach = this.near ? Math.max(20, 0.12 * size) : 0.75 * size;
    const [ca, sa, ch, sh] = [Math.cos(this.azimuth), Math.sin(this.azimuth), Math.cos(this.height), Math.sin(this.height)];
    const scale = 0.5 * tall / reach;
    const point = (n, e, u) => { // parallel projection, seen from azimuth and height
      const x = n - centre[0], y = e - centre[1], z = u - centre[2];
      const right = -sa * x + ca * y, away = ca * x + sa * y;
      return [0.5 * wide + scale * right, 0.5 * tall - scale * (z * ch - away * -sh)];
    };
    const line = (points, colour, width) => { g.strokeStyle = colour; g.lineWidth = width; g.beginPath(); points.forEach(([x, y], i) => g[i ? "lineTo" : "moveTo"](x, y)); g.stroke(); };
    const step = 10 ** Math.floor(Math.log10(reach)), from = v => Math.floor((v - 2 * reach) / step) * step;
    for (let i = 0; i <= 4 * reach / step; i++) { // ground
      const n = from(centre[0]) + i * step, e = from(centre[1]) + i * step;
      line([point(n, centre[1] - 2 * reach, this.ground), point(n, centre[1] + 2 * reach, this.ground)], ink("--line"), 0.7);
      line([point(centre[0] - 2 * reach, e, this.ground), point(centre[0] + 2 * reach, e, this.ground)], ink("--line"), 0.7);
    }
    const stride = Math.max(1, Math.floor(m.t.length / 4000)), flown = [], rest = [];
    for (let i = 0; i < m.t.length; i += stride) (i <= k ? flown : rest).push(point(m.north[i], m.east[i], m.up[i]));
    flown.push(point(...here)); rest.unshift(point(...here));
    line(rest, ink("--quiet"), 0.8); line(flown, ink("--accent"), 1.8);
    line([point(...here), point(here[0], here[1], this.ground)], ink("--quiet"), 0.8);
    const craft = reach * (this.near ? 0.5 : 0.1) / (0.5 * this.craft.span_m), [cf, sf] = [Math.cos(m.phi[k]), Math.sin(m.phi[k])], [ct, st] = [Math.cos(m.theta[k]), Math.sin(m.theta[k])], [cp, sp] = [Math.cos(m.psi[k]), Math.sin(m.psi[k])];
    const placed = ([x, y, z]) => { // body to earth, 3-2-1
      const y1 = y * cf - z * sf, z1 = y * sf + z * cf, x2 = x * ct + z1 * st, z2 = -x * st + z1 * ct;
      return [here[0] + craft * (x2 * cp - y1 * sp), here[1] + craft * (x2 * sp + y1 * cp), here[2] - craft * z2];
    };
    // seen from azimuth and height; what is farther away is drawn first, what faces up is lighter
    const faces = this.craft.faces.map(face => face.map(placed)).map(face => {
      const [a, b, c] = face, u = a.map((v, i) => b[i] - v), v = a.map((w, i) => c[i] - w);
      const normal = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]], size = Math.hypot(...normal) || 1;
      return { face, light: Math.abs(0.25 * normal[0] - 0.15 * normal[1] + 0.95 * normal[2]) / size, depth: face.reduce((s, [n, e, z]) => s + (ca * n + sa * e) * ch - z * sh, 0) / face.length };
    }).sort((a, b) => b.depth - a.depth);
    const [paper, quiet] = [ink("--paper"), ink("--quiet")];
    g.strokeStyle = ink("--ink"); g.lineWidth = 0.4; g.lineJoin = "round";
    for (const { face, light } of faces) {
      g.beginPath(); face.forEach((p, i) => g[i ? "lineTo" : "moveTo"](...point(...p))); g.closePath();
      g.fillStyle = `color-mix(in srgb, ${paper} ${Math.round(45 + 55 * Math.min(1, light))}%, ${quiet})`; g.fill(); g.stroke();
    }
    const deg = v => `${(v * 180 / Math.PI).toFixed(0)}°`.replace("-", "−");
    this.says.textContent = `${m.t[k].toFixed(1)} s: roll ${deg(m.phi[k])}, pitch ${deg(m.theta[k])}, heading ${deg(m.psi[k])}, ${m.up[k].toFixed(0)} m; a square is ${step >= 1 ? step : step.toFixed(1)} m`;
  }
}
