"""Token, time limits and header names of the gateway: shared by server and client."""

import re
from pathlib import Path

from pydantic import Field

from pmcl_ros.runtime.errors import SettingsError
from pmcl_ros.runtime.settings import Settings

TIME_HEADER = 'Gateway-Time-Ns'  # this machine's clock, 19 digits: a robot's may be another
_TOKEN = re.compile(r'[A-Za-z0-9._~+/=-]{16,512}')  # what RFC 6750 allows in a header


class GatewaySettings(Settings):
    """Time limits of a gateway's client."""

    timeout: float = Field(10.0, gt=0, le=600, description='longest wait for a connection, or '
                           'for the next bytes of a picture; an answer that has begun may take '
                           'twice this time and 1 s for each 50 kB [s]')
    answer_timeout: float = Field(90.0, gt=0, le=3600, description='longest silence '
                                  'before an answer; the gateway sends a sign of life every few '
                                  'seconds while its camera works [s]')
    answer_limit: float = Field(900.0, gt=0, le=36_000, description='longest time until an answer '
                                'begins, however much is sent before it [s]')
    patience: float = Field(20.0, gt=0, le=3600, description='retry until nothing was received '
                            'for this time [s]')


def read_token(path: Path | str) -> str:
    """The token in a file, without surrounding white space.

    Raises SettingsError when the file cannot be read or its token is too short to be safe.
    """
    try:
        with Path(path).open(encoding='ascii') as stream:
            token = stream.read(1000).strip()
    except (OSError, UnicodeDecodeError) as error:
        raise SettingsError(f'cannot read a token from {path}: {error}') from None
    return check_token(token, f'what {path} holds')


def check_token(token: str, what: str = 'this') -> str:
    """Return the token; SettingsError when it is too short to be safe, or has other characters."""
    if not _TOKEN.fullmatch(token):
        raise SettingsError(f'{what} is no token: expected 16 to 512 letters, digits and '
                            '._~+/=-, as `openssl rand -hex 16 > FILE` makes one')
    return token
