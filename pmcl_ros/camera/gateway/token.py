"""The word that a robot shows to a gateway."""

import re
from pathlib import Path

from pmcl_ros.runtime.errors import SettingsError

_TOKEN = re.compile(r'[A-Za-z0-9._~+/=-]{16,512}')  # what RFC 6750 allows in a header


def read_token(path: Path | str) -> str:
    """The token in a file, white space around it dropped.

    Raises SettingsError when the file cannot be read or its token is too short to be safe.
    """
    try:
        with Path(path).open(encoding='ascii') as stream:
            token = stream.read(1000).strip()
    except (OSError, UnicodeDecodeError) as error:
        raise SettingsError(f'cannot read a token from {path}: {error}') from None
    return check_token(token, f'what {path} holds')


def check_token(token: str, what: str = 'this') -> str:
    """The token itself; SettingsError when it is too short to be safe, or no word."""
    if not _TOKEN.fullmatch(token):
        raise SettingsError(f'{what} is no token: expected 16 to 512 letters, digits and '
                            '._~+/=-, as `openssl rand -hex 16 > FILE` makes one')
    return token
