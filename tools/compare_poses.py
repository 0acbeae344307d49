"""Whether two checkouts find the same poses, digit for digit, in the same captures.

    python tools/compare_poses.py run CAPTURES --checkout DIR --out poses.json    # once for each
    python tools/compare_poses.py compare before.json after.json

`run` calls `DIR/.venv/bin/pmcl localize` on every capture with an object and a region
in a folder, with several seeds, in both modes. `compare` exits with 1 where anything differs.
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path

COMPARED = ('position', 'orientation_xyzw', 'covariance', 'score', 'lost')
FILTER = 'faithful_iterations=20'  # enough that any difference shows


def run(captures: Path, checkout: Path, seeds: int) -> dict[str, object]:
    """The output of `pmcl localize --json`, by capture, mode and seed."""
    found: dict[str, object] = {}
    pmcl = [checkout / '.venv' / 'bin' / 'python', '-m', 'pmcl_ros.cli']
    cameras = checkout / 'config' / 'cameras'
    for truth in sorted(captures.glob('*/truth.json')):
        known = json.loads(truth.read_text())
        folder = truth.parent
        if 'roi' not in known or not (folder / 'model.obj').exists():
            continue
        region = [*known['roi']['center'], *known['roi']['size']]
        for mode in ('default', 'faithful'):
            for seed in range(seeds if mode == 'default' else 1):
                command = [*pmcl, 'localize', folder / 'IMG.RAW.xz', '--calibration',
                           cameras / 'demo.yaml', '--white', cameras / 'demo_white.RAW.xz',
                           '--object', folder / 'model.obj', '--roi', *region, '--mode', mode,
                           '--seed', seed, '--json']
                command += ['--set', FILTER] if mode == 'faithful' else []
                done = subprocess.run([str(each) for each in command], cwd=checkout, check=True,
                                      stdout=subprocess.PIPE, text=True)
                estimate = json.loads(done.stdout)
                name = f'{folder.name} {mode} {seed}'
                found[name] = {key: estimate[key] for key in COMPARED}
                sys.stderr.write(f'{name}: {estimate["position"]}\n')
    return found


def compare(before: dict[str, object], after: dict[str, object]) -> list[str]:
    """The names of localisations that differ, or are in one file only."""
    return [name for name in sorted(before | after) if before.get(name) != after.get(name)]


def main() -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    verbs = parser.add_subparsers(dest='verb', required=True)
    runs = verbs.add_parser('run')
    runs.add_argument('captures', type=Path)
    runs.add_argument('--checkout', type=Path, required=True)
    runs.add_argument('--seeds', type=int, default=2)
    runs.add_argument('--out', type=Path, required=True)
    both = verbs.add_parser('compare')
    both.add_argument('before', type=Path)
    both.add_argument('after', type=Path)
    given = parser.parse_args()
    if given.verb == 'run':
        found = run(given.captures.absolute(), given.checkout.absolute(), given.seeds)
        given.out.write_text(json.dumps(found, indent=1) + '\n')
        return 0
    before, after = (json.loads(each.read_text()) for each in (given.before, given.after))
    differing = compare(before, after)
    for name in differing:
        sys.stdout.write(f'differs: {name}\n')
    sys.stdout.write(f'{len(before | after) - len(differing)} of {len(before | after)} '
                     'localisations are the same to the last digit\n')
    return 1 if differing else 0


if __name__ == '__main__':
    sys.exit(main())
