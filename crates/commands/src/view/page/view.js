// The page of `tpf view`: asks what there is to show, and shows a bag that is scrubbed through, or a node as it comes.
import { Hand, KINDS, by_finger } from './cards.js';
import { Traces, LINES } from './traces.js';
import { follow } from './live.js';

const $ = id => document.getElementById(id);
const root = document.documentElement;

/** Asks the server; an answer that is none is said on the page. */
async function ask(path) {
  const answer = await fetch(path);
  if (!answer.ok) throw new Error(`${path}: ${await answer.text() || answer.status}`);
  return answer.json();
}

function say(error) {
  $('state').hidden = false;
  $('state').className = 'state absent';
  $('state').textContent = error instanceof TypeError ? 'tpf view has ended: start it again.' : String(error.message);
}

/** Runs the newest of several requests: while one is under way, only the last of the others is kept. */
function newest(work) {
  let running = false, next;
  return async value => {
    next = [value];
    if (running) return;
    running = true;
    try { while (next) { const [now] = next; next = undefined; await work(now); } } catch (error) { say(error); }
    running = false;
  };
}

const minutes = (t, digits) => {
  const all = t.toFixed(digits), sign = t < 0 ? '-' : '', s = Math.abs(Number(all));
  return `${sign}${Math.floor(s / 60)}:${(s % 60).toFixed(digits).padStart(digits ? digits + 3 : 2, '0')}`;
};

function head(setup) {
  const what = setup.kind === 'live' ? 'Node' : 'Bag';
  document.title = `${setup.title}${setup.synthetic ? ' (synthetic)' : ''} - tpf view`;
  $('title').textContent = `${what} ${setup.title}`;
  $('synthetic').hidden = !setup.synthetic;
  $('from').textContent = setup.from;
  $('notes').replaceChildren(...setup.notes.map(note => Object.assign(document.createElement('li'), { textContent: note })));
}

/** Choices of what colours the taxels; only those that there are. */
function choices(setup, hand) {
  const there = KINDS.filter(kind => setup.regions.some(kind.is_there));
  $('shown').replaceChildren(...there.map(kind => {
    const label = document.createElement('label'), input = document.createElement('input');
    Object.assign(input, { type: 'radio', name: 'shown', value: kind.name, checked: kind === hand.kind });
    input.addEventListener('change', () => { hand.show_kind(kind); $('hint').textContent = hand.hint(); });
    label.append(input, kind.words);
    return label;
  }));
  $('hint').textContent = hand.hint();
}

/** The legend of the traces, which also shows and hides them. */
function legend(setup, traces) {
  const there = LINES.filter(line => setup.regions.some(region => region.has.includes(line.key)));
  const entries = there.map(line => {
    const label = document.createElement('label'), input = document.createElement('input'), swatch = document.createElement('span');
    Object.assign(input, { type: 'checkbox', checked: true });
    swatch.className = `swatch ${line.dash}`;
    swatch.style.borderTopColor = `var(${line.colour})`;
    input.addEventListener('change', () => { traces.show(line, input.checked); label.classList.toggle('off', !input.checked); });
    label.append(input, swatch, line.words);
    return label;
  });
  const kinds = [['contact', '--c2', 'faint'], ['flag, with an estimate', '--c1', ''], ['flag, without one', '--c5', '']];
  const boxes = kinds.map(([words, colour, faint]) => {
    const label = document.createElement('label'), swatch = document.createElement('span');
    swatch.className = `swatch box ${faint}`;
    swatch.style.background = `var(${colour})`;
    label.append(swatch, words);
    return label;
  });
  $('lines').replaceChildren(...entries, ...boxes);
}

/** A bag. */
function scrub(setup, hand, traces) {
  const whole = [0, Math.max(setup.duration_s, 0.1)];
  const view = { t: 0, window: whole, playing: false, speed: 1, before: 0 };
  const step = Math.min(...setup.regions.map(region => region.period_s ?? 0.01));
  const stage_at = t => setup.stages.findLast(stage => stage.t <= t);

  const load = newest(async ([from, to]) => {
    const points = Math.max(200, Math.min(4000, Math.round(traces.width)));
    const found = await ask(`traces?from=${from}&to=${to}&points=${points}`);
    traces.draw(found, [from, to]);
    root.dataset.window = JSON.stringify([from, to]);
  });
  const frame = newest(async t => {
    const frames = await ask(`frame?t=${t}`);
    hand.show(frames);
    root.dataset.t = t;
  });
  function go(t) {
    view.t = Math.min(Math.max(t, whole[0]), whole[1]);
    $('slider').value = view.t;
    $('clock').textContent = `${minutes(view.t, 3)} / ${minutes(whole[1], 0)}`;
    $('moment').textContent = `at ${minutes(view.t, 3)}`;
    const stage = stage_at(view.t);
    $('stage').textContent = stage ? `${stage.name || 'between items'}${stage.zero_load ? ' (nothing touches)' : ''}` : '';
    const [from, to] = view.window;
    if (view.t < from || view.t > to) look(view.t - (to - from) * 0.1, view.t + (to - from) * 0.9);
    traces.playhead(view.t);
    frame(view.t);
  }
  function look(from, to) {
    const span = Math.min(Math.max(to - from, 0.05), whole[1] - whole[0]);
    const begin = Math.min(Math.max(from, whole[0]), whole[1] - span);
    view.window = [begin, begin + span];
    $('whole').hidden = span >= whole[1] - whole[0];
    load(view.window);
  }
  const zoom = factor => {
    const [from, to] = view.window;
    look(view.t - (view.t - from) * factor, view.t + (to - view.t) * factor);
  };
  function play(on) {
    view.playing = on;
    view.before = performance.now();
    if (on && view.t >= whole[1]) go(0);
    $('play').textContent = on ? 'Pause' : 'Play';
    if (on) requestAnimationFrame(tick);
  }
  function tick(now) {
    if (!view.playing) return;
    const t = view.t + (now - view.before) / 1000 * view.speed;
    view.before = now;
    go(t);
    if (t >= whole[1]) play(false); else requestAnimationFrame(tick);
  }
  const keys = {
    ' ': () => play(!view.playing),
    ArrowLeft: event => go(view.t - (event.shiftKey ? 1 : step)),
    ArrowRight: event => go(view.t + (event.shiftKey ? 1 : step)),
    PageUp: () => go(view.t - 10), PageDown: () => go(view.t + 10),
    Home: () => go(0), End: () => go(whole[1]),
    '+': () => zoom(0.5), '-': () => zoom(2), 0: () => look(...whole),
  };
  addEventListener('keydown', event => {
    const key = keys[event.key];
    const writes = event.target.matches('select') || (event.key === ' ' && event.target.matches('button, input[type=checkbox], input[type=radio]'))
      || (event.key.startsWith('Arrow') && event.target.matches('input[type=radio]'));
    if (!key || writes || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    key(event);
  });
  $('slider').max = whole[1];
  $('slider').addEventListener('input', () => go(Number($('slider').value)));
  $('play').addEventListener('click', () => play(!view.playing));
  $('back').addEventListener('click', () => go(view.t - step));
  $('forward').addEventListener('click', () => go(view.t + step));
  $('whole').addEventListener('click', () => look(...whole));
  $('speed').append(...[0.1, 0.25, 0.5, 1, 2, 5, 20].map(speed => new Option(`${speed} x`, speed, speed === 1, speed === 1)));
  $('speed').addEventListener('change', () => { view.speed = Number($('speed').value); });
  traces.on_seek = go;
  traces.on_window = look;
  traces.on_resize = () => load(view.window);
  $('transport').hidden = false;
  $('traces-hint').textContent = 'Click: go there. Drag: look closer. Keys: space plays, left and right go by frames (with Shift by '
    + 'seconds), page up and down by 10 s, + and - zoom, 0 shows the whole bag.';
  look(...whole);
  go(0);
}

try {
  const setup = await ask('setup');
  head(setup);
  const hand = new Hand($('hand'), setup);
  const traces = new Traces($('traces'), setup, by_finger(setup.regions).flatMap(([, regions]) => regions),
    setup.kind === 'live' ? t => `${t.toFixed(0)} s` : minutes);
  choices(setup, hand);
  legend(setup, traces);
  const redraw = () => { hand.draw(); traces.redraw(); };
  matchMedia('(prefers-color-scheme: dark)').addEventListener('change', redraw);
  // Paper is light, and narrower than a window.
  addEventListener('beforeprint', () => { root.classList.add('paper'); traces.resize(680); redraw(); });
  addEventListener('afterprint', () => { root.classList.remove('paper'); traces.resize(); redraw(); });
  if (setup.kind === 'live') follow(setup, hand, traces); else scrub(setup, hand, traces);
  root.dataset.ready = 'true';
} catch (error) {
  say(error);
}
