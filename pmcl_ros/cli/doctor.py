"""`pmcl doctor`: checks this machine, and advises."""

import click
from rich.console import Console

from pmcl_ros.doctor import examine

_SIGNS = {'ok': '[green]ok   [/]', 'note': '[yellow]note [/]', 'wrong': '[red]WRONG[/]'}


@click.command()
@click.option('--camera', metavar='ADDRESS',
              help='Look for a Lytro too: HOST, HOST:PORT, or mdns.')
@click.pass_context
def doctor(context: click.Context, camera: str | None) -> None:
    """Check this machine: Python, packages, OpenGL, memory, ROS, and with --camera a camera.

    Exit status 1 when something is wrong; a note does not stop anything.
    """
    console = Console(highlight=False, soft_wrap=True)
    wrong = 0
    for finding in examine(camera):
        console.print(f'{_SIGNS[finding.verdict]} {finding.what}: ', end='')
        console.print(finding.found, markup=False)
        if finding.advice:
            console.print(f'      {finding.advice}', markup=False)
        wrong += finding.verdict == 'wrong'
    context.exit(int(wrong > 0))
