"""metadata.yaml of a bag, version 9 as of Jazzy; quality of service as bags have it."""

from pathlib import Path, PurePath
from typing import Any, Literal, NamedTuple

import yaml
from pydantic import ConfigDict, Field
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)

from pmcl_ros.messages.cdr import typestore
from pmcl_ros.messages.mcap_records import Channel
from pmcl_ros.runtime.errors import BagError, FileError, SettingsError, told_as
from pmcl_ros.runtime.outputs import write_file
from pmcl_ros.runtime.settings import Settings
from pmcl_ros.runtime.text_file import parse_yaml, read_yaml_file

NAME = 'metadata.yaml'
_VERSION = 9  # of the file's form: that of ROS 2 Jazzy
_ROOT = 'rosbag2_bagfile_information'
_FOREVER = QosTime(9223372036, 854775807)  # RMW_DURATION_INFINITE
_KINDS = {'history': QosHistory, 'reliability': QosReliability, 'durability': QosDurability,
          'liveliness': QosLiveliness}
_TIMES = 'deadline', 'lifespan', 'liveliness_lease_duration'
_MOST_DEPTH = 2 ** 31  # DDS holds it in a signed 32-bit integer


def offered(durability: QosDurability) -> Qos:
    """Reliable, keep last 1: what every publisher of the chain's big topics offers."""
    return Qos(QosHistory.KEEP_LAST, 1, QosReliability.RELIABLE, durability, _FOREVER, _FOREVER,
               QosLiveliness.AUTOMATIC, _FOREVER, avoid_ros_namespace_conventions=False)


class BagFiles(Settings):
    """What metadata.yaml says of a bag's files; what is in them they say themselves."""

    model_config = ConfigDict(extra='ignore')

    version: int = Field(ge=1, le=_VERSION)
    storage_identifier: Literal['mcap', 'sqlite3']
    relative_file_paths: list[str] = Field(min_length=1, max_length=10_000)
    compression_format: Literal['zstd', ''] | None = ''
    compression_mode: str | None = ''

    @property
    def each_packed(self) -> bool:
        """Whether rosbag2 has compressed the messages one by one."""
        return bool(self.compression_format) and (self.compression_mode or '').lower() == 'message'

    @classmethod
    def read(cls, bag: Path) -> 'BagFiles':
        """Read the file of a bag. Raises BagError."""
        with told_as(BagError, FileError, SettingsError):
            values = read_yaml_file(bag / NAME).get(_ROOT)
            if not isinstance(values, dict):
                raise BagError(f'{bag / NAME} has no {_ROOT}')
            return cls.make(values, str(bag / NAME))

    def paths(self, bag: Path) -> list[Path]:
        """The files, which lie in the folder whatever older versions write before their names."""
        return [bag / PurePath(each).name for each in self.relative_file_paths]


class Written(NamedTuple):
    """What is in a file that was written."""

    file: str
    channels: list[tuple[Channel, Qos, int]]  # with the number of messages
    start_ns: int
    duration_ns: int


def metadata_of(written: Written) -> dict[str, Any]:
    """The content of metadata.yaml."""
    span = {'duration': {'nanoseconds': written.duration_ns},
            'starting_time': {'nanoseconds_since_epoch': written.start_ns},
            'message_count': sum(count for *_, count in written.channels)}
    topics = [{'topic_metadata': {'name': channel.topic, 'type': channel.type,
                                  'serialization_format': channel.encoding,
                                  'offered_qos_profiles': [_as_dict(qos)],
                                  'type_description_hash': typestore().hash_rihs01(channel.type)},
               'message_count': count} for channel, qos, count in written.channels]
    return {'version': _VERSION, 'storage_identifier': 'mcap',
            'relative_file_paths': [written.file], **span, 'topics_with_message_count': topics,
            'compression_format': '', 'compression_mode': '',
            'files': [{'path': written.file, **span}], 'custom_data': None,
            'ros_distro': 'rosbags'}


def write(path: Path, values: dict[str, Any]) -> None:
    """Write a metadata.yaml at once: a folder that has one is a bag. Raises OutputError."""
    write_file(path, as_yaml({_ROOT: values}))


def as_yaml(values: Any) -> str:
    """YAML as rosbag2's parser takes it: no aliases, no long lines broken."""
    return yaml.dump(values, Dumper=_Plain, width=1000, default_flow_style=False)


class _Plain(yaml.SafeDumper):
    def ignore_aliases(self, data: Any) -> bool:  # noqa: ARG002
        return True


def qos_text(qos: Qos) -> str:
    """Quality of service as a file's channel has it."""
    return as_yaml([_as_dict(qos)])


def qos_from(text: str, topic: str) -> Qos | None:
    """The first of the offered qualities of service; None where there is none.

    Raises BagError, which names the topic, for what is no quality of service. Values are names,
    or numbers in bags before Jazzy.
    """
    try:
        profiles = parse_yaml(text, 'offered_qos_profiles') or []
        if not profiles:
            return None
        values = profiles[0]
        kinds = [_kind(kind, values[name]) for name, kind in _KINDS.items()]
        times = [QosTime(int(values[name]['sec']), int(values[name]['nsec'])) for name in _TIMES]
        depth = int(values['depth'])
        if not 0 <= depth < _MOST_DEPTH:
            raise BagError(f'the depth is {depth}')
        history, reliability, durability, liveliness = kinds
        return Qos(history, depth, reliability, durability, times[0], times[1], liveliness,
                   times[2], bool(values['avoid_ros_namespace_conventions']))
    except (BagError, FileError, LookupError, TypeError, ValueError, OverflowError) as error:
        raise BagError(f'{topic} has no quality of service that is known: {error}') from None


def _kind(kind: Any, value: Any) -> Any:
    """A member by name or number; UNKNOWN for one of newer versions."""
    if isinstance(value, str):
        return kind.__members__.get(value.upper(), kind.UNKNOWN)
    return kind(value) if value in [each.value for each in kind] else kind.UNKNOWN


def _as_dict(qos: Qos) -> dict[str, Any]:
    times = {name: {'sec': getattr(qos, name).sec, 'nsec': getattr(qos, name).nsec}
             for name in _TIMES}
    return {**{name: getattr(qos, name).name.lower() for name in _KINDS}, 'depth': qos.depth,
            **times, 'avoid_ros_namespace_conventions': qos.avoid_ros_namespace_conventions}
