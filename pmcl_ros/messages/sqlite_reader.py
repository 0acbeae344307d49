"""Reads the SQLite files of bags, as rosbag2 wrote them before MCAP."""

import sqlite3
from collections.abc import Container, Iterator
from contextlib import closing
from pathlib import Path

from pmcl_ros.messages.mcap_records import MOST_CHUNK, Channel
from pmcl_ros.runtime.errors import BagError

_PLENTY = 500_000_000  # steps of SQLite's machine for one answer: some seconds
_IS_TABLE = ("SELECT type = 'table' AND sql NOT LIKE 'create virtual%' AND NOT EXISTS "
             '(SELECT 1 FROM pragma_table_xinfo(file.name) WHERE hidden) '
             'FROM sqlite_master AS file WHERE name = ?')


class SqliteReader:
    """A file that is open, as `McapReader`. It has no checksums."""

    checked = False

    def __init__(self, path: Path) -> None:
        self._file = sqlite3.connect(f'{path.absolute().as_uri()}?mode=ro', uri=True)
        self.channels: dict[int, Channel] = {}
        self.counts: dict[int, int] = {}
        try:
            self._file.execute('PRAGMA trusted_schema = OFF')
            self._file.set_progress_handler(lambda: 1, _PLENTY)
            for table in ('topics', 'messages'):  # a view, or what is computed, may never end
                if self._file.execute(_IS_TABLE, (table,)).fetchone() != (1,):
                    raise BagError(f'it has no table {table}: is it of rosbag2?')
            for number, *fields in self._file.execute(
                    'SELECT id, name, type, serialization_format, offered_qos_profiles '
                    'FROM topics'):
                self.channels[int(number)] = Channel(*map(str, fields))
            self.counts = {int(number): int(count) for number, count in self._file.execute(
                'SELECT topic_id, count(*) FROM messages GROUP BY topic_id')}
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def messages(self, channels: Container[int]) -> Iterator[tuple[int, int, bytes]]:
        """(time, channel, data) of all messages of some channels, in the order of their times."""
        with closing(self._file.cursor()) as cursor:
            for number, time, channel, size in cursor.execute(
                    'SELECT id, timestamp, topic_id, length(data) FROM messages '
                    'ORDER BY timestamp, id'):
                if channel not in channels:
                    continue
                if not isinstance(size, int) or size > MOST_CHUNK:
                    raise BagError(f'message {number} has {size} bytes')
                data, = self._file.execute('SELECT data FROM messages WHERE id = ?',
                                           (number,)).fetchone()
                yield int(time), channel, bytes(data)
