"""`pmcl camera gateway`: a camera for robots that cannot join its Wi-Fi."""

import contextlib
import signal
import sys
import threading
from contextlib import closing
from pathlib import Path

import click

from pmcl_ros.camera.gateway.server import GatewayServer
from pmcl_ros.camera.gateway.service import Cache, Service
from pmcl_ros.camera.gateway.settings import read_token
from pmcl_ros.camera.lytro.address import Address, find_camera
from pmcl_ros.camera.lytro.client import LytroClient
from pmcl_ros.cli.base import FILE
from pmcl_ros.runtime.errors import CameraError


@click.command()
@click.option('--host', required=True, help='Address of this machine to serve at, as the robot '
              'reaches it; 127.0.0.1 for this machine alone.')
@click.option('--port', default=5680, show_default=True, type=click.IntRange(0, 65535),
              help='Port to serve at; 0: any free one.')
@click.option('--camera', default=Address().host, show_default=True,
              metavar='HOST[:PORT[:CALLBACK_PORT]]', help='Where the camera is; mdns: the '
              'one that announces itself.')
@click.option('--token-file', type=FILE, help='File of the token that a robot must show. Required '
              'unless HOST is a loopback address.')
@click.option('--cache', type=click.Path(exists=True, file_okay=False, path_type=Path),
              help='Where to keep fetched pictures while it runs.  [default: temporary files]')
@click.option('--cache-size', default=512, show_default=True, type=click.IntRange(1),
              help='How much of them, MB.')
def gateway(host: str, port: int, camera: str, token_file: Path | None, cache: Path | None,
            cache_size: int) -> None:
    """Hand out the camera's pictures over HTTP, until interrupted.

    For a machine that has joined the camera's Wi-Fi and is in the robot's network too. What is
    sent is not encrypted: use a network, or a tunnel, that you trust.
    """
    if camera != 'mdns':
        Address.parse(camera)  # a mistake is told now, not at the first request
    token = None if token_file is None else read_token(token_file)

    def connect() -> LytroClient:
        return LytroClient(find_camera(camera))

    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    with (closing(Service(connect, Cache(cache, cache_size * 1_000_000))) as service,
          GatewayServer(service, host, port, token) as server):
        click.echo(f'gateway at {server.url}')
        threading.Thread(target=_greet, args=(service,), daemon=True).start()
        with contextlib.suppress(KeyboardInterrupt):
            server.serve_forever()


def _greet(service: Service) -> None:
    """Say which camera it is, once it answers; meanwhile requests are served."""
    try:
        status = service.status()
    except CameraError as error:
        click.echo(f'{error}; every request tries again', err=True)
    else:
        click.echo(str(status))
