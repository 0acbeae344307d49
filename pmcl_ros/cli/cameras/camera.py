"""`pmcl camera`: a Lytro on the network, a simulated one, and a gateway to one."""

import asyncio
import contextlib
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import closing
from functools import partial
from pathlib import Path

import click
from rich.progress import BarColumn, DownloadColumn, Progress, TransferSpeedColumn

from pmcl_ros.camera.client import Picture
from pmcl_ros.camera.files import picture_files, write_picture
from pmcl_ros.camera.gateway.server import GatewayServer
from pmcl_ros.camera.gateway.service import Cache, Service
from pmcl_ros.camera.gateway.settings import read_token
from pmcl_ros.camera.lytro.address import Address, LinkSettings, find_camera
from pmcl_ros.camera.lytro.client import LytroClient
from pmcl_ros.camera.lytro.protocol import PictureRecord
from pmcl_ros.camera.simulated.camera import SimulatedCamera
from pmcl_ros.camera.simulated.card import Card
from pmcl_ros.camera.simulated.faults import HELP, Faults
from pmcl_ros.camera.simulated.server import READY, CameraServer, announced
from pmcl_ros.cli.base import FILE, FOLDER, FORCE, RAW_FOLDER, STDERR
from pmcl_ros.runtime.errors import CameraError, LinkError, PmclError
from pmcl_ros.runtime.outputs import refuse_existing

_PORT = click.IntRange(0, 65535)
_USUAL_SECOND_PORT = 5679
_FIRST_FOLDER = '100PHOTO'  # of a card


@click.group()
def camera() -> None:
    """A Lytro on the network, and a simulated one."""


@camera.command(epilog='\b\nFaults:\n' + HELP)
@click.option('--pictures', required=True, type=RAW_FOLDER,
              help='Folder of RAW[.xz] with TXT, or of LFP, also in subfolders. White images '
              '(modulationFrame) become the calibration files.')
@click.option('--host', default='127.0.0.1', show_default=True, help='Address to listen at.')
@click.option('--port', default=5678, show_default=True, type=_PORT,
              help='Port for commands; 0: any free one.')
@click.option('--callback-port', default=5677, show_default=True, type=_PORT,
              help='Port for callbacks; 0: any free one.')
@click.option('--second-port', type=_PORT, help='Another port for commands.  [default: 5679 with '
              '--port 5678, else none]')
@click.option('--delay', default=0.5, show_default=True, type=click.FloatRange(0, 3600),
              help='From the shutter to NewPictureAvailable, seconds.')
@click.option('--battery', default=87.5, show_default=True, type=click.FloatRange(0, 100),
              help='Charge, percent.')
@click.option('--empty', is_flag=True, help='Start with an empty card; else it holds PICTURES.')
@click.option('--fault', multiple=True, metavar='FAULT', help='Fault to simulate, see below.')
@click.option('--mdns', is_flag=True, help='Announce the camera by mDNS.')
def serve(pictures: Path, host: str, port: int, callback_port: int, second_port: int | None,
          delay: float, battery: float, empty: bool, fault: tuple[str, ...], mdns: bool) -> None:
    """Simulate a Lytro F01 for any client, until interrupted.

    Each capture command adds the next one of PICTURES, in turn. It was tested with other people's
    clients, but never compared with a real camera.
    """
    if second_port is None and port == Address().port:
        second_port = _USUAL_SECOND_PORT
    card = Card.from_folder(pictures, empty=empty)
    simulated = SimulatedCamera(card, faults=Faults.parse(fault), delay=delay, battery=battery)
    server = CameraServer(simulated, host, port, callback_port, second_port)
    with announced(server.address, card.serial) if mdns else contextlib.nullcontext():
        asyncio.run(_until_interrupted(server, f'{len(card.records)} pictures'))


async def _until_interrupted(server: CameraServer, what: str) -> None:
    task = asyncio.ensure_future(server.run())
    for each in (signal.SIGINT, signal.SIGTERM):
        asyncio.get_running_loop().add_signal_handler(each, task.cancel)
    address = server.address
    click.echo(f'{READY}{address.text} (commands on {address.port}, callbacks on '
               f'{address.callback_port}), {what}')
    with contextlib.suppress(asyncio.CancelledError):
        await task


@camera.command()
@click.option('--address', default=Address().host, show_default=True,
              metavar='HOST[:PORT[:CALLBACK_PORT]]', help='Where the camera is; mdns: the '
              'one that announces itself.')
@click.option('-o', '--out', type=FOLDER, help='Folder for RAW and TXT; the time of a file is '
              'that of the shutter.')
@click.option('--count', default=1, show_default=True, type=click.IntRange(1),
              help='Pictures to take.')
@click.option('--list', 'listing', is_flag=True, help='List the pictures instead.')
@click.option('--download', metavar='NAME|all', help='Download IMG_0001, or all that OUT does not '
              'have, instead.')
@click.option('--delete', is_flag=True, help='Delete downloaded pictures from the camera.')
@FORCE
@click.option('--timeout', default=LinkSettings().picture_timeout, show_default=True,
              type=click.FloatRange(0.1, 3600), help='Longest wait for a picture, seconds.')
def capture(address: str, out: Path | None, count: int, listing: bool, download: str | None,
            delete: bool, force: bool, timeout: float) -> None:
    """Take pictures, and save them.

    A picture of another folder of the card than 100PHOTO goes to a folder of that name: its number
    may be there twice.
    """
    if (out is None) != listing or (listing and (download or delete)):
        raise click.UsageError('give --out, or --list alone')
    with LytroClient(find_camera(address), LinkSettings(picture_timeout=timeout)) as client:
        status = client.status()
        click.echo(str(status), err=True)
        if out is None:
            for record in client.records():
                click.echo(f'{_name(record)}  {record.date}  {record.id}')
            return
        unsaved = undeleted = 0
        for picture, record in _wanted(client, download, count, out, force):
            name = _name(record)
            if not _succeeds(name, partial(_save, client, picture, record, out, force)):
                unsaved += 1
            elif delete and not _succeeds(name, partial(client.delete, picture)):
                undeleted += 1
        if unsaved:
            raise CameraError(f'{unsaved} pictures were not saved; they are on the camera, unless '
                              'somebody deleted them')
        if undeleted:
            raise CameraError(f'{undeleted} saved pictures were not deleted from the camera')


def _succeeds(name: str, step: Callable[[], None]) -> bool:
    """Whether a step of one picture succeeds; its error is printed. Raises LinkError."""
    try:
        step()
    except LinkError:
        raise
    except PmclError as error:
        click.echo(f'{name}: {error}', err=True)
        return False
    return True


def _wanted(client: LytroClient, download: str | None, count: int, out: Path, force: bool
            ) -> Iterator[tuple[Picture, PictureRecord]]:
    """The pictures to save, oldest first; without `download` they are taken one by one."""
    if download is None:
        for _ in range(count):
            picture = client.capture()
            yield picture, client.record(picture)
        return
    pictures = client.pictures()
    records = {each.id: each for each in client.records()}
    found = [(each, records[each.id]) for each in pictures if each.id in records]
    names = [_name(record) for _, record in found]
    if download not in ('all', *names):
        last = ', '.join(names[-20:]) or 'nothing'
        raise CameraError(f'the camera has no {download}, only {last}')
    if download == 'all':
        wanted = [each for each in found if force or not _is_kept(out, each[1])]
        if len(wanted) < len(found):
            click.echo(f'{len(found) - len(wanted)} of {len(found)} pictures are in {out} already',
                       err=True)
    else:
        wanted = [each for each in found if _name(each[1]) == download]
    yield from wanted


def _name(record: PictureRecord) -> str:
    """As in IMG_0001, or 101PHOTO/IMG_0001: numbers begin anew in each folder of the card."""
    return (record.name if record.folder_name == _FIRST_FOLDER
            else f'{record.folder_name}/{record.name}')


def _is_kept(out: Path, record: PictureRecord) -> bool:
    return any((out / f'{_name(record)}{end}').exists() for end in ('.RAW', '.RAW.xz'))


def _save(client: LytroClient, picture: Picture, record: PictureRecord, out: Path, force: bool
          ) -> None:
    path = out / f'{_name(record)}.RAW'
    refuse_existing(picture_files(path), force)  # first: the download takes long
    with Progress('{task.description}', BarColumn(), DownloadColumn(), TransferSpeedColumn(),
                  console=STDERR, transient=True) as bar:
        task = bar.add_task(_name(record))
        raw, text = client.fetch(
            picture, lambda got, total: bar.update(task, completed=got, total=total))
    write_picture(path, raw, text, force)
    for each in picture_files(path):
        os.utime(each, ns=(picture.shutter_ns, picture.shutter_ns))
    click.echo(path)


@camera.command()
@click.option('--host', required=True, help='Address of this machine to serve at, as the robot '
              'reaches it; 127.0.0.1 for this machine alone.')
@click.option('--port', default=5680, show_default=True, type=click.IntRange(0, 65535),
              help='Port to serve at; 0: any free one.')
@click.option('--camera', 'address', default=Address().host, show_default=True,
              metavar='HOST[:PORT[:CALLBACK_PORT]]', help='Where the camera is; mdns: the '
              'one that announces itself.')
@click.option('--token-file', type=FILE, help='File of the token that a robot must show. Required '
              'unless HOST is a loopback address.')
@click.option('--cache', type=click.Path(exists=True, file_okay=False, path_type=Path),
              help='Where to keep fetched pictures while it runs.  [default: temporary files]')
@click.option('--cache-size', default=512, show_default=True, type=click.IntRange(1),
              help='Size limit of them, MB.')
def gateway(host: str, port: int, address: str, token_file: Path | None, cache: Path | None,
            cache_size: int) -> None:
    """Serve the camera's pictures over HTTP, until interrupted.

    For a machine in the camera's Wi-Fi and in the robot's network. The connection is not
    encrypted: use a network or a tunnel that you trust.
    """
    if address != 'mdns':
        Address.parse(address)  # reports a mistake now, not at the first request
    token = None if token_file is None else read_token(token_file)

    def connect() -> LytroClient:
        return LytroClient(find_camera(address))

    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    with (closing(Service(connect, Cache(cache, cache_size * 1_000_000))) as service,
          GatewayServer(service, host, port, token) as server):
        click.echo(f'gateway at {server.url}')
        threading.Thread(target=_greet, args=(service,), daemon=True).start()
        with contextlib.suppress(KeyboardInterrupt):
            server.serve_forever()


def _greet(service: Service) -> None:
    """Print the camera's identity as soon as it answers; requests are served meanwhile."""
    try:
        status = service.status()
    except CameraError as error:
        click.echo(f'{error}; every request tries again', err=True)
    else:
        click.echo(str(status))
