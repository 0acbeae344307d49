"""How a robot reaches a gateway, and how long that may take."""

from pydantic import Field

from pmcl_ros.runtime.settings import Settings


class GatewaySettings(Settings):
    """How long a gateway may take, in seconds."""

    timeout: float = Field(10.0, gt=0, le=600, description='wait so long for a connection, or '
                           'the next bytes of a picture [s]')
    answer_timeout: float = Field(90.0, gt=0, le=3600, description='wait so long until the '
                                  'gateway has an answer from its camera [s]')
    patience: float = Field(20.0, gt=0, le=3600, description='try again until nothing has come '
                            'for so long [s]')
