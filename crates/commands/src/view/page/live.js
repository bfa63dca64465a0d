// A running node: what comes is shown as it comes, and what no longer comes is never shown as if it did.
const $ = id => document.getElementById(id);

/** Time that the traces show, s. */
const SPAN = 20;
/** Without an update for so long, the program has ended, ms. */
const LOST_MS = 2000;
const COLUMNS = ['t', 'force', 'force_base', 'artifact', 'contact', 'flags'];
const NEWEST = ['force', 'force_base', 'artifact', 'touch', 'pose_age', 'artifact_change', 'contact', 'flags', 'adaptation'];

const STATES = {
  present: ['LIVE', () => ''],
  waiting: ['WAITING', () => 'nothing has come yet; is the node running in this domain, and active?'],
  silent: ['SILENT', age => `the node is there or not known to be gone, but nothing has come for ${age.toFixed(1)} s`],
  gone: ['GONE', age => `the node is no longer in the graph; the last message came ${age.toFixed(1)} s ago`],
  lost: ['LOST', () => 'tpf view has ended or does not answer: start it again'],
};

export function follow(setup, hand, traces) {
  const buffers = setup.regions.map(() => Object.fromEntries(COLUMNS.map(name => [name, []])));
  const frames = setup.regions.map(() => null);
  let came = performance.now(), update = null, missed = 0, paused = false;
  const nothing = setup.regions.map(() => null);

  function take(now) {
    [update, came] = [now, performance.now()];
    now.regions.forEach((region, idx) => {
      const buffer = buffers[idx], n = region.t.length;
      COLUMNS.forEach(name => buffer[name].push(...region[name]));
      const newest = buffer.t.at(-1), old = buffer.t.findIndex(t => t >= newest - SPAN - 1);
      if (old > 0) COLUMNS.forEach(name => buffer[name].splice(0, old));
      if (n) frames[idx] = { ...Object.fromEntries(NEWEST.map(name => [name, region[name][n - 1]])), t: region.t[n - 1] };
      if (frames[idx]) frames[idx].reading = region.reading ?? [];
    });
  }

  function state() {
    const is_lost = performance.now() - came > LOST_MS;
    const name = is_lost ? 'lost' : update?.state ?? 'waiting';
    const [word, words] = STATES[name];
    const place = $('state'), strong = document.createElement('strong');
    const told = [words((update?.age_s ?? 0) + (is_lost ? (performance.now() - came) / 1000 : 0))];
    if (name === 'present') {
      told.push(`${update.rate_hz.toFixed(0)} frames a second`);
      if (update.latency_ms) told.push(`stamp to here p50 ${update.latency_ms[0].toFixed(1)} ms, p99 ${update.latency_ms[1].toFixed(1)} ms`);
    }
    if (update?.skipped) told.push(`${update.skipped} frames left out`);
    if (missed) told.push(`this page missed ${missed} updates`);
    if (paused) told.push('PAUSED: the page stands still, the node does not');
    strong.textContent = word;
    place.hidden = false;
    place.className = name === 'present' && !paused ? 'state' : 'state absent';
    place.replaceChildren(strong, ` ${told.filter(Boolean).join('; ')}`);
    document.documentElement.dataset.state = name;
    return name;
  }

  function draw() {
    const name = state();
    if (paused) return;
    hand.show(name === 'present' ? frames : nothing);
    const newest = Math.max(...buffers.map(buffer => buffer.t.at(-1) ?? -Infinity));
    if (Number.isFinite(newest)) {
      // What is old moves on, also when nothing comes.
      const end = newest + (name === 'present' ? 0 : (update?.age_s ?? 0) + Math.max(0, performance.now() - came - 100) / 1000);
      traces.draw(buffers.map(buffer => ({ ...buffer, t: buffer.t.map(t => t - end) })), [-SPAN, 0]);
    }
    const list = (update?.diagnostics ?? []).map(([level, of, message]) => {
      const item = document.createElement('li');
      item.textContent = `${level} ${of}: ${message}`;
      return item;
    });
    $('diagnostics').replaceChildren(...list);
    $('health').hidden = !list.length;
    const late = update?.diagnostics_late_s;
    $('health-late').hidden = late === null || late === undefined;
    $('health-late').textContent = late ? `The node said this ${late.toFixed(0)} s ago, and nothing since.` : '';
    const notes = [...setup.notes, ...(update?.notes ?? [])];
    if ($('notes').children.length !== notes.length) {
      $('notes').replaceChildren(...notes.map(note => Object.assign(document.createElement('li'), { textContent: note })));
    }
  }

  const events = new EventSource('updates');
  events.addEventListener('message', event => take(JSON.parse(event.data)));
  events.addEventListener('missed', event => { missed += Number(event.data); });
  addEventListener('keydown', event => {
    if (event.key !== ' ' || event.target.matches('button, input, select')) return;
    event.preventDefault();
    paused = !paused;
  });
  $('traces-hint').textContent = `The last ${SPAN} s. Space: the page stands still, or goes on.`;
  // Not at every update: a page in the background draws nothing.
  let drawn = 0;
  const tick = now => {
    if (now - drawn > 30) { drawn = now; draw(); }
    requestAnimationFrame(tick);
  };
  requestAnimationFrame(tick);
}
