// The hand: a card for each region, with its taxels as a heat map, and what is told of it at one moment.

/** Fingers as they lie beside each other. */
const FINGERS = ['thumb', 'index', 'middle', 'ring', 'little', 'palm'];

/** What may colour the taxels; the first that there is is shown. */
export const KINDS = [
  {
    name: 'above', words: 'Above the zero',
    hint: 'Taxels above their zero-load reading, in the unit of the sensor.',
    is_there: region => region.zero !== null,
    values: (region, frame) => frame.reading.map((value, idx) => value === null ? null : region.sign * (value - region.zero[idx])),
    range: region => {
      const ends = region.readings.flatMap(({ low, high }, idx) => low === null ? [] : [low - region.zero[idx], high - region.zero[idx]]);
      const most = Math.max(...ends.map(Math.abs), 0);
      return [-most, most];
    },
  },
  {
    name: 'corrected', words: 'Artifact removed',
    hint: 'Taxels above their zero, with what bending reads taken out, as the model is given them.',
    is_there: region => region.features !== null && region.has.includes('artifact_change'),
    values: (region, frame) => frame.feature,
    range: region => {
      const most = Math.max(Math.abs(region.features.low), Math.abs(region.features.high));
      return [-most, most];
    },
  },
  {
    name: 'sent', words: 'As sent',
    hint: 'Readings as the sensor sent them.',
    is_there: region => region.n_taxels > 0,
    values: (region, frame) => frame.reading,
    range: region => {
      const ends = region.readings.flatMap(({ low, high }) => [low, high]).filter(value => value !== null);
      return [Math.min(...ends), Math.max(...ends)];
    },
  },
];

const number = (value, digits) => value === null || value === undefined ? '\u2013' : (Math.abs(value) < 0.5 * 10 ** -digits ? 0 : value).toFixed(digits);
const short = value => !Number.isFinite(value) ? '' : Math.abs(value) >= 100 ? value.toFixed(0) : value.toPrecision(2);

/** Values beside the force, in the order of a card: name, words, factor, digits, unit. */
const VALUES = [
  ['force_base', 'taxels alone', 1, 2, 'N'],
  ['truth', 'true force', 1, 2, 'N'],
  ['artifact', 'artifact', 1, 2, 'N'],
  ['touch', 'probability of touch', 100, 0, '%'],
  ['pose_age', 'age of the pose', 1000, 0, 'ms'],
  ['artifact_change', 'artifact changed by', 100, 1, '%'],
];

const element = (name, properties = {}, ...children) => {
  const made = Object.assign(document.createElement(name), properties);
  made.append(...children);
  return made;
};

const rgb = name => {
  const hex = getComputedStyle(document.documentElement).getPropertyValue(name).trim().slice(1);
  return [0, 2, 4].map(at => parseInt(hex.slice(at, at + 2), 16));
};
const mix = (from, to, share) => from.map((value, idx) => Math.round(value + (to[idx] - value) * share));

/** Fingers, and which regions are on each; those that name no finger come last. */
export function by_finger(regions) {
  const on = finger => regions.flatMap((region, idx) => region.finger === finger ? [idx] : []);
  return [...FINGERS, null].map(finger => [finger, on(finger)]).filter(([, there]) => there.length);
}

export class Hand {
  constructor(place, setup) {
    this.setup = setup;
    this.kind = KINDS.find(kind => setup.regions.some(kind.is_there));
    this.live_ranges = setup.regions.map(() => null);
    this.frames = setup.regions.map(() => null);
    this.cards = setup.regions.map(region => this.card(region));
    const groups = by_finger(setup.regions).map(([finger, regions]) => [finger, regions.map(idx => this.cards[idx])]);
    const several = groups.some(([finger, cards]) => finger !== null && cards.length > 1);
    place.replaceChildren(...groups.flatMap(([finger, cards]) => {
      if (finger === null) return cards.map(card => card.place);
      const heading = several ? [element('h3', { textContent: finger })] : [];
      return [element('div', { className: 'finger' }, ...heading, ...cards.map(card => card.place))];
    }));
    new ResizeObserver(() => this.draw()).observe(place);
  }

  /** What the taxels show, and where they are. */
  hint() {
    if (!this.kind) return '';
    const taken = this.kind.name === 'above' && !this.setup.regions.some(KINDS[1].is_there) && this.setup.kind === 'computed'
      ? ' These models take the artifact out of the force, not out of the taxels.' : '';
    const guessed = this.setup.regions.some(region => region.n_taxels > 1 && !region.is_layout_told)
      ? ' The parameters do not say where taxels are on the skin (layout.shape): such a grid is in the order of the region\u2019s taxels, row by row.'
      : '';
    const signs = this.kind.name === 'sent' ? '' : ' Blue is above the zero, orange below it.';
    return `${this.kind.hint}${signs}${taken}${guessed}`;
  }

  card(region) {
    const parts = {
      canvas: element('canvas', { role: 'img' }), chip: element('span', { className: 'chip' }),
      force: element('output', {}), flags: element('p', { className: 'flags' }), adaptation: element('p', { className: 'adaptation' }),
      low: element('span'), high: element('span'), values: new Map(),
    };
    parts.canvas.setAttribute('aria-label', `taxels of ${region.name}`);
    const list = element('dl');
    for (const [key, words] of VALUES.filter(([key]) => region.has.includes(key))) {
      const value = element('dd', { textContent: '\u2013' });
      parts.values.set(key, value);
      list.append(element('dt', { textContent: words }), value);
    }
    const map = region.n_taxels ? [parts.canvas, element('div', { className: 'range' }, parts.low, parts.high)] : [];
    parts.place = element('article', { className: 'card' },
      element('header', {}, element('h3', { textContent: region.name }), parts.chip), ...map,
      element('p', { className: 'force' }, parts.force, element('small', { textContent: ' N' })), list, parts.flags, parts.adaptation);
    parts.place.dataset.region = region.name;
    return parts;
  }

  /** Shows a frame of each region, or none. */
  show(frames) {
    this.frames = frames;
    this.cards.forEach((card, idx) => {
      const frame = frames[idx], { place } = card;
      place.classList.toggle('touched', Boolean(frame?.contact));
      card.chip.textContent = frame ? (frame.contact ? 'contact' : 'no contact') : 'no data';
      card.force.textContent = number(frame?.force, 2);
      place.dataset.force = frame?.force ?? '';
      place.dataset.t = frame?.t ?? '';
      place.dataset.contact = frame?.contact ?? '';
      for (const [key, , factor, digits, unit] of VALUES) {
        const value = card.values.get(key), told = frame?.[key] ?? null;
        if (!value) continue;
        value.textContent = told === null ? number(null) : `${number(factor * told, digits)} ${unit}`;
        value.dataset.value = frame?.[key] ?? '';
      }
      const set = this.setup.flags.filter(flag => frame && (frame.flags & flag.bit) !== 0);
      const unknown = frame ? frame.flags & ~this.setup.flags.reduce((all, flag) => all | flag.bit, 0) : 0;
      card.flags.textContent = [...set.map(flag => flag.name), ...(unknown ? [`unknown ${unknown}`] : [])].join(' ');
      card.flags.classList.toggle('bad', set.some(flag => flag.without_estimate));
      card.adaptation.textContent = frame?.adaptation ? `Artifact ${this.setup.adaptations[frame.adaptation]}.` : '';
    });
    this.draw();
  }

  show_kind(kind) {
    this.kind = kind;
    this.live_ranges.fill(null);
    this.draw();
  }

  draw() {
    const colours = { none: rgb('--grid'), paper: rgb('--paper'), more: rgb('--c0'), less: rgb('--c5'), ink: rgb('--ink') };
    this.cards.forEach((card, idx) => {
      const region = this.setup.regions[idx];
      if (region.n_taxels) this.draw_card(card, region, this.frames[idx], idx, colours);
    });
  }

  /** Range of the colours: of the whole session, or of a live node as far as it has come. */
  range(region, values, idx) {
    if (region.readings.length) return this.kind.range(region);
    const ends = values.filter(value => value !== null);
    const [low, high] = this.live_ranges[idx] ?? [Infinity, -Infinity];
    const now = this.kind.name === 'sent' ? [Math.min(low, ...ends), Math.max(high, ...ends)]
      : [Math.min(low, -Math.max(...ends.map(Math.abs))), Math.max(high, ...ends.map(Math.abs))];
    return ends.length ? this.live_ranges[idx] = now : now;
  }

  draw_card(card, region, frame, idx, colours) {
    const { canvas } = card, n = region.n_taxels;
    const is_there = frame && this.kind.is_there(region) && frame.reading?.length === n;
    const values = is_there ? this.kind.values(region, frame) : Array(n).fill(null);
    const [low, high] = this.range(region, values, idx);
    const { columns } = region, rows = Math.ceil(n / columns);
    const width = canvas.clientWidth || 160, cell = Math.min(width / columns, 46), height = Math.ceil(cell * rows), scale = devicePixelRatio || 1;
    if (canvas.width !== Math.round(width * scale) || canvas.height !== Math.round(height * scale)) {
      Object.assign(canvas, { width: Math.round(width * scale), height: Math.round(height * scale) });
      canvas.style.height = `${height}px`;
    }
    const to = canvas.getContext('2d');
    to.setTransform(scale, 0, 0, scale, 0, 0);
    to.clearRect(0, 0, width, height);
    const across = width / columns;
    to.font = `${Math.min(12, cell * 0.34)}px system-ui, sans-serif`;
    to.textAlign = 'center';
    to.textBaseline = 'middle';
    values.forEach((value, taxel) => {
      const x = taxel % columns * across, y = Math.floor(taxel / columns) * cell;
      let colour = value === null ? colours.none : colours.paper;
      if (value !== null && high > low) {
        colour = low < 0 && this.kind.name !== 'sent'
          ? mix(colours.paper, value < 0 ? colours.less : colours.more, Math.min(1, Math.abs(value) / high) ** 0.7)
          : mix(colours.paper, colours.more, (value - low) / (high - low));
      }
      to.fillStyle = `rgb(${colour})`;
      to.fillRect(x + 0.5, y + 0.5, across - 1, cell - 1);
      to.strokeStyle = `rgb(${colours.none})`;
      to.strokeRect(x + 0.5, y + 0.5, across - 1, cell - 1);
      if (cell >= 24 && value !== null) {
        const bright = (colour[0] * 299 + colour[1] * 587 + colour[2] * 114) / 1000;
        to.fillStyle = bright > 140 ? '#1a1a1a' : '#ffffff';
        to.fillText(short(value), x + across / 2, y + cell / 2);
      }
    });
    card.low.textContent = high > low ? short(low) : '';
    card.high.textContent = high > low ? short(high) : '';
    card.place.dataset.taxels = JSON.stringify(values);
  }
}
