"""Opens a page in headless Chromium, wide and as on a phone, and tells as JSON what a person would see of it.

usage: look_at_page.py PAGE.html [SCREENSHOT.png]
"""

import json
import os
import sys

from playwright.sync_api import sync_playwright

ARGS = [
    "--no-sandbox",  # in containers Chromium runs as root
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
SIZES = {"wide": (1200, 900), "phone": (390, 844)}

PLOTS = """() => [...document.querySelectorAll('.plot > div')].map(plot => ({
    id: plot.id,
    traces: (plot.data || []).length,
    with_points: (plot.data || []).filter(trace => ((trace.z || trace.y || []).length > 0)).length,
    width: plot.querySelector('.main-svg')?.getBoundingClientRect().width ?? 0,
    drawn: plot.querySelectorAll('.scatterlayer path, .barlayer path, .heatmaplayer image').length,
    words: [...plot.querySelectorAll('.annotation-text')].map(text => text.textContent),
}))"""
TABLES = """() => Object.fromEntries([...document.querySelectorAll('table')].map(table => [table.id,
    [...table.querySelectorAll('tbody tr')].map(row => [...row.children].map(cell => ({
        text: cell.textContent, value: 'value' in cell.dataset ? Number(cell.dataset.value) : null })))]))"""


def look(page, path, size):
    complaints, requests = [], []
    page.on("console", lambda message: complaints.append(f"{message.type}: {message.text}"))
    page.on("pageerror", lambda error: complaints.append(f"error: {error}"))
    page.on("request", lambda request: requests.append(request.url))
    page.set_viewport_size({"width": size[0], "height": size[1]})
    page.goto(f"file://{os.path.abspath(path)}")
    page.wait_for_load_state("load")
    page.wait_for_function("[...document.querySelectorAll('.plot > div')].every(plot => plot.querySelector('.main-svg'))")
    return {
        "complaints": complaints,
        "requests": [url for url in requests if not url.startswith(("file:", "data:", "blob:"))],
        "text": page.inner_text("body"),
        "page_width": page.evaluate("document.documentElement.scrollWidth"),
        "plots": page.evaluate(PLOTS),
        "tables": page.evaluate(TABLES),
    }


def main():
    chromium = os.environ.get("CHROMIUM", "/usr/bin/chromium")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=ARGS)
        seen = {}
        for name, size in SIZES.items():
            page = browser.new_page()
            seen[name] = look(page, sys.argv[1], size)
            if name == "wide" and len(sys.argv) > 2:
                page.screenshot(path=sys.argv[2], full_page=True)
        browser.close()
    print(json.dumps(seen))


if __name__ == "__main__":
    main()
