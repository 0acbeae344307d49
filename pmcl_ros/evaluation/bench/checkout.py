"""What benches take from a checkout of the sources: a bag, its camera, its object."""

from pathlib import Path

ROOT = Path(__file__).parents[3]
BAG = ROOT / 'bags' / 'wine_glass'
CALIBRATION = ROOT / 'config' / 'cameras' / 'demo.yaml'
WHITE = ROOT / 'config' / 'cameras' / 'demo_white.RAW.xz'
# Of pmcl_node: hardly a search.
QUICK = {'mode': 'faithful', 'faithful_iterations': 1, 'faithful_particles': 4}


def object_in(bag: Path) -> Path:
    """The mesh of what a shipped bag shows."""
    return ROOT / 'models' / f'{bag.name}.obj'
