// Forces over time: a plot for each region, with bands of contact and a strip of flags.

/** The lines of a plot. */
export const LINES = [
  { key: 'truth', words: 'true force', colour: '--truth', dash: 'dot', pattern: [3, 3], width: 1.5 },
  { key: 'force_base', words: 'taxels alone', colour: '--c1', dash: 'dash', pattern: [7, 4], width: 1.5 },
  { key: 'artifact', words: 'artifact', colour: '--c3', dash: '', pattern: [], width: 1 },
  { key: 'force', words: 'force', colour: '--c0', dash: '', pattern: [], width: 2 },
];
const HEIGHT = 132, STRIP = 6;
const colour = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

/** Stretches of consecutive points for which something holds: first and last index, and what it is. */
function* stretches(values, what) {
  let from = 0, held = what(values[0]);
  for (let at = 1; at <= values.length; at++) {
    const now = at < values.length ? what(values[at]) : undefined;
    if (now === held) continue;
    if (held) yield [from, at - 1, held];
    [from, held] = [at, now];
  }
}

export class Traces {
  constructor(place, setup, order, minutes) {
    Object.assign(this, { place, setup, minutes, window: [0, 1], t: null, on_seek: () => {}, on_window: () => {}, on_resize: () => {} });
    this.without = setup.flags.filter(flag => flag.without_estimate).reduce((all, flag) => all | flag.bit, 0);
    this.found = setup.regions.map(() => null);
    this.width = place.clientWidth;
    this.plots = [];
    for (const idx of order) this.plots[idx] = this.plot(setup.regions[idx], idx);
    new ResizeObserver(() => {
      if (Math.abs(place.clientWidth - this.width) < 2 || document.documentElement.classList.contains('paper')) return;
      this.resize();
      this.on_resize();
    }).observe(place);
  }

  plot(region, idx) {
    const place = document.createElement('div'), title = document.createElement('h3'), small = document.createElement('small');
    place.className = 'trace';
    place.dataset.region = region.name;
    title.append(region.name, small);
    place.append(title);
    this.place.append(place);
    const axis = { stroke: () => colour('--muted'), grid: { stroke: () => colour('--grid'), width: 1 }, ticks: { show: false }, font: '11px system-ui, sans-serif' };
    const span = () => this.window[1] - this.window[0];
    const plot = new uPlot({
      width: this.width, height: HEIGHT, legend: { show: false }, padding: [6, 16, 0, 0],
      cursor: { sync: { key: 'view' }, points: { show: false }, drag: { x: true, y: false, setScale: false } },
      scales: {
        x: { time: false, range: () => this.window },
        y: { range: (_, low, high) => [Math.min(low ?? 0, 0) - 0.05, Math.max(high ?? 0, 2 * region.force_on, 0.2) * 1.05] },
      },
      axes: [
        { ...axis, size: 20, gap: 2, values: (_, ticks) => ticks.map(t => this.minutes(t, span() < 3 ? 2 : span() < 20 ? 1 : 0)) },
        { ...axis, size: 44, values: (_, ticks) => ticks.map(force => `${+force.toFixed(3)} N`) },
      ],
      series: [{}, ...LINES.map(line => ({
        label: line.words, stroke: () => colour(line.colour), width: line.width, dash: line.pattern, points: { show: false }, spanGaps: false,
        show: region.has.includes(line.key),
      }))],
      hooks: {
        drawClear: [plot => this.bands(plot, idx)],
        draw: [plot => this.strip(plot, idx)],
        setSelect: [plot => {
          const { left, width } = plot.select;
          if (width < 4) return;
          plot.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
          this.selected = performance.now();
          this.on_window(plot.posToVal(left, 'x'), plot.posToVal(left + width, 'x'));
        }],
      },
    }, [[], ...LINES.map(() => [])], place);
    const head = document.createElement('div');
    head.className = 'playhead';
    head.hidden = true;
    plot.over.append(head);
    plot.over.addEventListener('click', event => {
      if (performance.now() - (this.selected ?? -1e9) > 300) this.on_seek(plot.posToVal(event.offsetX, 'x'));
    });
    return { plot, head, small };
  }

  /** Draws the traces of a window of time. */
  draw(found, window) {
    [this.found, this.window] = [found, window];
    this.plots.forEach(({ plot, small }, idx) => {
      const traces = found[idx];
      plot.setData([traces.t, ...LINES.map(line => traces[line.key] ?? traces.t.map(() => null))], true);
      const all = traces.flags.reduce((all, flags) => all | flags, 0);
      const names = this.setup.flags.filter(flag => all & flag.bit).map(flag => flag.name);
      const joined = traces.full_rate === false ? 'many frames a point: smallest and largest' : '';
      small.textContent = [names.length ? `flags here: ${names.join(', ')}` : '', joined].filter(Boolean).join('; ');
    });
    this.playhead(this.t);
  }

  bands(plot, idx) {
    const traces = this.found[idx];
    if (!traces?.t.length) return;
    const { ctx: to, bbox } = plot;
    to.save();
    to.beginPath();
    to.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    to.clip();
    to.fillStyle = colour('--c2');
    to.globalAlpha = 0.22;
    for (const [from, last] of stretches(traces.contact, contact => contact)) {
      const [x0, x1] = this.pixels(plot, traces.t, from, last);
      to.fillRect(x0, bbox.top, Math.max(x1 - x0, 1), bbox.height);
    }
    to.restore();
  }

  strip(plot, idx) {
    const traces = this.found[idx];
    if (!traces?.t.length) return;
    const { ctx: to, bbox } = plot, height = STRIP * (devicePixelRatio || 1);
    to.save();
    to.beginPath();
    to.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    to.clip();
    const level = flags => flags & this.without ? '--c5' : flags ? '--c1' : '';
    for (const [from, last, name] of stretches(traces.flags, level)) {
      const [x0, x1] = this.pixels(plot, traces.t, from, last);
      to.fillStyle = colour(name);
      to.fillRect(x0, bbox.top + bbox.height - height, Math.max(x1 - x0, 1), height);
    }
    to.restore();
  }

  /** From the first of some points to the one after the last, in pixels of the canvas. */
  pixels(plot, t, from, last) {
    return [t[from], t[Math.min(last + 1, t.length - 1)]].map(at => plot.valToPos(at, 'x', true));
  }

  /** Marks a time in all plots. */
  playhead(t) {
    this.t = t;
    this.plots.forEach(({ plot, head }) => {
      const is_there = t !== null && t >= this.window[0] && t <= this.window[1];
      head.hidden = !is_there;
      if (is_there) head.style.left = `${plot.valToPos(t, 'x')}px`;
    });
  }

  show(line, is_shown) {
    const series = LINES.indexOf(line) + 1;
    this.plots.forEach(({ plot }, idx) => {
      plot.setSeries(series, { show: is_shown && this.setup.regions[idx].has.includes(line.key) });
    });
  }

  resize(width = this.place.clientWidth) {
    this.width = width;
    this.plots.forEach(({ plot }) => plot.setSize({ width, height: HEIGHT }));
    this.playhead(this.t);
  }

  redraw() {
    this.plots.forEach(({ plot }) => plot.redraw(false));
  }
}
