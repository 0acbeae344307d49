"""Where the camera is and how long it may take."""

import re

from pydantic import Field

from pmcl_ros.runtime.errors import SettingsError
from pmcl_ros.runtime.settings import Settings


class Address(Settings):
    """Where a camera answers; by default where a Lytro is in its own network."""

    host: str = Field('10.100.1.1', min_length=1, description='name or address of the camera')
    port: int = Field(5678, ge=1, le=65535, description='TCP port for commands')
    callback_port: int = Field(5677, ge=1, le=65535, description='TCP port for callbacks')

    @classmethod
    def parse(cls, text: str) -> 'Address':
        """Read HOST[:PORT[:CALLBACK_PORT]]; an IPv6 host stands in brackets.

        Raises SettingsError when it is none.
        """
        found = re.fullmatch(r'(?:\[([^][]+)\]|([^][:]+))(?::(\d{1,5})(?::(\d{1,5}))?)?', text)
        if not found:
            raise SettingsError(f'no address of a camera: {text!r}; expected HOST, HOST:PORT or '
                                'HOST:PORT:CALLBACK_PORT, as in 10.100.1.1')
        names = ('host', 'port', 'callback_port')
        given = (found[1] or found[2], found[3], found[4])
        return cls.make({name: value for name, value in zip(names, given, strict=True) if value},
                        text)

    @property
    def text(self) -> str:
        """What `parse` reads."""
        return f'{self}:{self.callback_port}'

    def __str__(self) -> str:
        host = f'[{self.host}]' if ':' in self.host else self.host
        return f'{host}:{self.port}'


class LinkSettings(Settings):
    """How long the camera may take, in seconds."""

    timeout: float = Field(5.0, gt=0, le=600, description='wait so long for a connection, a '
                           'reply or the next bytes of one [s]')
    patience: float = Field(20.0, gt=0, le=3600, description='reconnect and try again until '
                            'nothing has come for so long [s]')
    picture_timeout: float = Field(30.0, gt=0, le=3600, description='from the command to take a '
                                   'picture until it can be downloaded [s]')
    watchdog: float = Field(5.0, gt=0, le=600, description='the callback connection is lost when '
                            'nothing comes for so long; a tick comes every 0.1 s [s]')
    keep_alive: float = Field(25.0, gt=0, le=240, description='ask for the battery when nothing '
                              'else was asked for so long: after 300 s of silence the camera '
                              'turns its Wi-Fi off [s]')
