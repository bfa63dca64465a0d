"""Opens a page of `tpf view` in headless Chromium, uses it as a person would, and tells as JSON what is seen.

usage: look_at_view.py URL [--times T,T,...] [--folder FOLDER] [--live SECONDS [--ready FILE]]

It looks at the page on a desktop, on a phone, and dark. On the desktop it also moves the slider to each of the times, plays,
zooms, and prints. With a FOLDER it writes desktop.png, phone.png, dark.png and paper.pdf there, with paper.png of its first
page where `pdftoppm` is. With --live it looks at a node until it is gone, at most so long, and tells each state that the page
showed. It makes the FILE when the page is open.
"""

import argparse
import json
import os
import shutil
import subprocess
import time
from urllib.parse import urlsplit

from playwright.sync_api import sync_playwright

from look_at_page import ARGS

VIEWS = {
    "desktop": {"viewport": {"width": 1440, "height": 900}},
    "phone": {"viewport": {"width": 390, "height": 844}, "is_mobile": True, "has_touch": True, "device_scale_factor": 2},
    "dark": {"viewport": {"width": 1440, "height": 900}, "color_scheme": "dark"},
}
CARDS = """() => Object.fromEntries([...document.querySelectorAll('.card')].map(card => [card.dataset.region, {
    force: card.dataset.force, t: card.dataset.t, contact: card.dataset.contact, text: card.innerText,
    taxels: JSON.parse(card.dataset.taxels ?? 'null'), shown: card.querySelector('output').textContent,
    values: Object.fromEntries([...card.querySelectorAll('dd')].map(value => [value.previousSibling.textContent, value.dataset.value])) }]))"""
NOW = f"() => ({{ state: document.documentElement.dataset.state, text: document.getElementById('state').innerText, cards: ({CARDS})() }})"
# A plot is drawn if its canvas has pixels that are not those of its background.
PLOTS = """() => Object.fromEntries([...document.querySelectorAll('.trace')].map(trace => {
    const canvas = trace.querySelector('canvas');
    const copy = Object.assign(document.createElement('canvas'), { width: canvas.width, height: canvas.height });
    const to = copy.getContext('2d', { willReadFrequently: true });
    to.drawImage(canvas, 0, 0);
    const pixels = to.getImageData(0, 0, canvas.width, canvas.height).data;
    const colours = new Set();
    for (let at = 0; at < pixels.length; at += 4) if (pixels[at + 3] > 200) colours.add(pixels[at] << 16 | pixels[at + 1] << 8 | pixels[at + 2]);
    const head = trace.querySelector('.playhead');
    return [trace.dataset.region, { colours: colours.size, width: canvas.clientWidth, playhead: head.hidden ? null : parseFloat(head.style.left) }];
}))"""
PAPER = """() => {
    dispatchEvent(new Event('beforeprint'));
    return new Promise(done => setTimeout(() => {
        const width = Math.max(...[...document.querySelectorAll('.trace canvas')].map(plot => plot.getBoundingClientRect().width));
        const background = getComputedStyle(document.body).backgroundColor;
        dispatchEvent(new Event('afterprint'));
        done({ width, background });
    }, 50));
}"""


def settled(page, t):
    page.wait_for_function("t => Math.abs(Number(document.documentElement.dataset.t) - t) < 1e-9", arg=t)


def use(page, times):
    """Moves through a bag as a person would."""
    seen = {"at": [], "traces": page.evaluate(PLOTS)}
    slider = page.locator("#slider")
    for t in times:
        slider.evaluate("(slider, t) => { slider.value = t; slider.dispatchEvent(new Event('input')); }", t)
        settled(page, t)
        seen["at"].append({"t": t, "cards": page.evaluate(CARDS), "plots": page.evaluate(PLOTS)})
    kinds = page.locator("#shown input").all()
    seen["kinds"] = {}
    for kind in kinds:
        kind.check()
        seen["kinds"][kind.get_attribute("value")] = page.evaluate(CARDS)
    if kinds:
        kinds[0].check()
    page.locator("h1").click()
    page.keyboard.press("Home")
    settled(page, 0)
    page.keyboard.press("Shift+ArrowRight")
    settled(page, 1)
    page.keyboard.press(" ")
    page.wait_for_function("() => Number(document.documentElement.dataset.t) > 1.3")
    page.keyboard.press(" ")
    page.wait_for_timeout(300)
    stopped = page.evaluate("document.documentElement.dataset.t")
    page.wait_for_timeout(300)
    seen["stands_still"] = page.evaluate("document.documentElement.dataset.t") == stopped
    whole = page.evaluate("document.documentElement.dataset.window")
    changed = "before => document.documentElement.dataset.window !== before"
    page.keyboard.press("+")
    page.wait_for_function(changed, arg=whole)
    seen["zoomed"] = json.loads(page.evaluate("document.documentElement.dataset.window"))
    page.keyboard.press("0")
    page.wait_for_function("whole => document.documentElement.dataset.window === whole", arg=whole)
    plot = page.locator(".trace .u-over").first.bounding_box()
    middle = plot["y"] + plot["height"] / 2
    page.mouse.move(plot["x"] + plot["width"] * 0.25, middle)
    page.mouse.down()
    page.mouse.move(plot["x"] + plot["width"] * 0.5, middle, steps=5)
    page.mouse.up()
    page.wait_for_function(changed, arg=whole)
    seen["dragged"] = json.loads(page.evaluate("document.documentElement.dataset.window"))
    page.wait_for_timeout(400)
    page.mouse.click(plot["x"] + plot["width"] * 0.5, middle)
    middle_t = sum(seen["dragged"]) / 2
    page.wait_for_function("t => Math.abs(Number(document.documentElement.dataset.t) - t) < 0.2", arg=middle_t)
    page.locator("#whole").click()
    page.wait_for_function("whole => document.documentElement.dataset.window === whole", arg=whole)
    seen["whole"] = json.loads(whole)
    return seen


def watch(page, seconds):
    """Looks at a node: each state in turn, with what the cards showed then."""
    states, end = [], time.monotonic() + seconds
    while time.monotonic() < end and (not states or states[-1]["state"] != "gone"):
        now = page.evaluate(NOW)  # at once, because the page goes on
        state = now["state"]
        if states and states[-1]["state"] == state:
            states[-1].update(now)
        else:
            states.append(now)
        page.wait_for_timeout(100)
    return {"states": states, "plots": page.evaluate(PLOTS)}


def look(page, url, args, view):
    complaints, elsewhere = [], []
    ours = urlsplit(url).netloc
    page.on("console", lambda message: complaints.append(f"{message.type}: {message.text}"))
    page.on("pageerror", lambda error: complaints.append(f"error: {error}"))
    page.on("request", lambda request: elsewhere.append(request.url) if not is_ours(request.url, ours) else None)
    page.goto(url)
    page.wait_for_function("() => document.documentElement.dataset.ready")
    seen = {}
    if args.live:
        if view == "desktop":
            if args.ready:
                open(args.ready, "w").close()
            seen = watch(page, args.live)
        else:
            page.wait_for_function("() => document.documentElement.dataset.state")
    else:
        settled(page, 0)
        page.wait_for_function("() => document.documentElement.dataset.window")
        if view == "desktop":
            seen = use(page, args.times)
        if args.times:
            slider = page.locator("#slider")
            slider.evaluate("(slider, t) => { slider.value = t; slider.dispatchEvent(new Event('input')); }", args.times[0])
            settled(page, args.times[0])
    page.wait_for_timeout(100)
    if args.folder:
        page.mouse.move(0, 0)
        page.screenshot(path=os.path.join(args.folder, f"{view}.png"))
        if view == "phone":
            page.screenshot(path=os.path.join(args.folder, "phone_whole.png"), full_page=True)
        if view == "desktop":
            paper = os.path.join(args.folder, "paper.pdf")
            page.pdf(path=paper, format="A4", print_background=True, prefer_css_page_size=True)
            if shutil.which("pdftoppm"):
                stem = os.path.join(args.folder, "paper")
                subprocess.run(["pdftoppm", "-png", "-r", "80", "-singlefile", paper, stem], check=True)
    return {
        **seen,
        "complaints": complaints,
        "elsewhere": elsewhere,
        "text": page.inner_text("body"),
        "page_width": page.evaluate("document.documentElement.scrollWidth"),
        "background": page.evaluate("getComputedStyle(document.body).backgroundColor"),
        "paper": page.evaluate(PAPER),
    }


def is_ours(url, ours):
    return url.startswith("data:") or urlsplit(url).netloc == ours


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("url")
    parser.add_argument("--times", type=lambda text: [float(t) for t in text.split(",")], default=[])
    parser.add_argument("--folder")
    parser.add_argument("--live", type=float, default=0)
    parser.add_argument("--ready")
    args = parser.parse_args()
    chromium = os.environ.get("CHROMIUM", "/usr/bin/chromium")
    seen = {}
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=ARGS)
        for view, context in VIEWS.items():
            page = browser.new_context(**context).new_page()
            seen[view] = look(page, args.url, args, view)
            page.close()
        browser.close()
    print(json.dumps(seen))


if __name__ == "__main__":
    main()
