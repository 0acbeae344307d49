"""What a real browser makes of a page: headless Chromium, without a network."""

import html
import json
import re
import shutil
import subprocess
from typing import NamedTuple

import pytest

NAMES = ('chromium', 'chromium-browser', 'google-chrome')
WIDTHS = (390, 1280)  # px: of a phone, of a desk
# The page itself is left as it is, in a frame as wide as the screen would be. Pictures that are
# put into the wrapper when a frame has loaded hold its own load back: that it is measured by then
# does not depend on how busy the machine is.
WRAPPER = """<!DOCTYPE html><pre id="measured"></pre><script>
const drawn = new Map();
function draw(frame) {
  drawn.set(frame, [...frame.contentDocument.querySelectorAll('image')].map(each => {
    const picture = document.body.appendChild(new Image());
    picture.src = each.href.baseVal;
    return picture;
  }));
}
addEventListener('load', () => {
  const measured = [...document.querySelectorAll('iframe')].map(frame => {
    const page = frame.contentDocument, view = frame.contentWindow;
    return {
      viewport: view.innerWidth, width: page.documentElement.scrollWidth,
      pictures: [...page.images].map(each => each.naturalWidth),
      drawn: drawn.get(frame).map(each => each.naturalWidth),
      dark: view.matchMedia('(prefers-color-scheme: dark)').matches,
      background: view.getComputedStyle(page.body).backgroundColor,
      loaded: view.performance.getEntriesByType('resource').map(each => each.name),
      texts: Object.fromEntries([...page.querySelectorAll('[id]')].map(
        each => [each.id, each.textContent]))};
  });
  document.getElementById('measured').textContent = JSON.stringify(measured);
});
</script>FRAMES"""


class Seen(NamedTuple):
    """measured: for each of WIDTHS, what the script above writes. console: the browser's lines."""

    measured: list
    console: list


def browser():
    """Chromium's path; skips the test where there is none."""
    found = next(filter(None, map(shutil.which, NAMES)), None)
    if found is None:
        pytest.skip('no Chromium, nor Chrome: the page is not looked at')
    return found


def look(page, folder, dark=False):
    """Open a page (a file) in frames of all widths."""
    frames = ''.join(f'<iframe src="{page.as_uri()}" width="{width}" height="800" '
                     'style="border: 0" onload="draw(this)"></iframe>' for width in WIDTHS)
    wrapper = folder / 'wrapper.html'
    wrapper.write_text(WRAPPER.replace('FRAMES', frames))
    done = subprocess.run(
        [browser(), '--headless', '--no-sandbox', '--disable-gpu', '--disable-dev-shm-usage',
         '--no-first-run', f'--user-data-dir={folder / "profile"}', '--enable-logging=stderr',
         '--v=0', '--allow-file-access-from-files', '--host-resolver-rules=MAP * ~NOTFOUND',
         f'--blink-settings=preferredColorScheme={0 if dark else 1}',
         '--dump-dom', wrapper.as_uri()],
        capture_output=True, text=True, check=True, timeout=240)
    text = re.search('<pre id="measured">(.*?)</pre>', done.stdout, re.DOTALL).group(1)
    assert text, f'the page was not measured: {done.stderr[-2000:]}'
    console = [line for line in done.stderr.splitlines() if 'CONSOLE' in line]
    return Seen(json.loads(html.unescape(text)), console)
