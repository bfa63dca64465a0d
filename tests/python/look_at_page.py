"""Opens a page in headless Chromium and tells as JSON what a person would see of it: wide, as on a phone, dark, and on paper.

usage: look_at_page.py PAGE.html [FOLDER]

With a FOLDER it also writes the whole page there, wide.png, phone.png, dark.png and paper.pdf, what is seen first of it, such as
wide_first.png, and each plot as ID.png.
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
VIEWS = {
    "wide": {"viewport": {"width": 1200, "height": 900}},
    "phone": {"viewport": {"width": 390, "height": 844}, "is_mobile": True, "has_touch": True},
    "dark": {"viewport": {"width": 1200, "height": 900}, "color_scheme": "dark"},
}

PLOTS = """() => [...document.querySelectorAll('.plot > div')].map(plot => {
    const boxes = name => [...plot.querySelectorAll(name)].map(one => one.getBoundingClientRect()).filter(box => box.width);
    const meet = (a, b) => a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom;
    return {
        id: plot.id,
        traces: (plot.data || []).length,
        with_points: (plot.data || []).filter(trace => ((trace.z || trace.y || []).length > 0)).length,
        width: plot.querySelector('.main-svg')?.getBoundingClientRect().width ?? 0,
        drawn: plot.querySelectorAll('.scatterlayer path, .barlayer path, .heatmaplayer image').length,
        words: [...plot.querySelectorAll('.annotation-text, .gtitle')].map(text => text.textContent),
        background: plot.querySelector('.main-svg')?.style.background,
        toolbar_on_legend: boxes('.modebar-group').some(bar => boxes('.legend').some(legend => meet(bar, legend))),
        data: (plot.data || []).map(trace => ({ name: trace.name, x: trace.x, y: trace.y, z: trace.z })),
    };
})"""
TABLES = """() => Object.fromEntries([...document.querySelectorAll('table')].map(table => [table.id,
    [...table.querySelectorAll('tbody tr')].map(row => [...row.children].map(cell => ({
        text: cell.textContent, value: 'value' in cell.dataset ? Number(cell.dataset.value) : null })))]))"""
PAPER = """() => {
    dispatchEvent(new Event('beforeprint'));
    const widths = [...document.querySelectorAll('.plot .main-svg')].map(plot => plot.getBoundingClientRect().width);
    dispatchEvent(new Event('afterprint'));
    return Math.max(0, ...widths);
}"""


def look(page, path):
    complaints, requests = [], []
    page.on("console", lambda message: complaints.append(f"{message.type}: {message.text}"))
    page.on("pageerror", lambda error: complaints.append(f"error: {error}"))
    page.on("request", lambda request: requests.append(request.url))
    page.goto(f"file://{os.path.abspath(path)}")
    page.wait_for_load_state("load")
    page.wait_for_function("[...document.querySelectorAll('.plot > div')].every(plot => plot.querySelector('.main-svg'))")
    return {
        "complaints": complaints,
        "requests": [url for url in requests if not url.startswith(("file:", "data:", "blob:"))],
        "text": page.inner_text("body"),
        "sections": page.evaluate("[...document.querySelectorAll('section')].map(section => section.id)"),
        "background": page.evaluate("getComputedStyle(document.body).backgroundColor"),
        "page_width": page.evaluate("document.documentElement.scrollWidth"),
        "paper_width": page.evaluate(PAPER),
        "plots": page.evaluate(PLOTS),
        "tables": page.evaluate(TABLES),
    }


def keep(page, name, folder):
    page.screenshot(path=os.path.join(folder, f"{name}.png"), full_page=True)
    page.screenshot(path=os.path.join(folder, f"{name}_first.png"))
    if name == "wide":
        for figure in page.locator("figure").all():
            name_of_plot = figure.locator(".plot > div").first.get_attribute("id")
            figure.screenshot(path=os.path.join(folder, f"{name_of_plot}.png"))
        page.pdf(path=os.path.join(folder, "paper.pdf"), format="A4", print_background=True, prefer_css_page_size=True)


def main():
    chromium = os.environ.get("CHROMIUM", "/usr/bin/chromium")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=ARGS)
        seen = {}
        for name, view in VIEWS.items():
            page = browser.new_context(**view).new_page()
            seen[name] = look(page, sys.argv[1])
            if len(sys.argv) > 2:
                keep(page, name, sys.argv[2])
        browser.close()
    print(json.dumps(seen))


if __name__ == "__main__":
    main()
