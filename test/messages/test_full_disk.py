"""A bag on a disk that becomes full, in a file system of a few megabytes."""

import subprocess
import sys

import pytest
import zstandard

from pmcl_ros.messages.bags import BagWriter, Recorded, read, record, topics

SCRIPT = 'mount -t tmpfs -o size=4m none "$1" && exec "$2" -c "$3" "$1" "$4"'
PROGRAM = """
import sys
from pathlib import Path
from zlib import crc32
import numpy as np
from pmcl_ros.messages.bags import BagWriter, Recorded, read, topics
from pmcl_ros.messages.mcap_records import HEAD, MAGIC, Op
from pmcl_ros.runtime.errors import BagError

disk, size = Path(sys.argv[1]), int(sys.argv[2])
random, written = np.random.default_rng(0), []
try:
    # With small ones as many chunks as a bag of ten gigabytes has.
    with BagWriter(disk / 'bag', chunk=1 if size < 100 else 2 ** 20) as writer:
        for number in range(4_000_000 // size):
            content = b'\\0\\1\\0\\0' + random.bytes(size)
            written.append(Recorded('/topic', 'std_msgs/msg/String', number, content))
            writer.write(written[-1])
except BagError as error:
    print(error)
found = list(read(disk / 'bag')) if (disk / 'bag').exists() else []
assert found == written[:len(found)]
assert not found or topics(disk / 'bag')[0].messages == len(found)
if found:
    data, place = (disk / 'bag' / 'bag.mcap').read_bytes(), len(MAGIC)
    while (head := HEAD.unpack_from(data, place))[0] != Op.DATA_END:
        place += HEAD.size + head[1]
    assert int.from_bytes(data[place + HEAD.size:][:4], 'little') == crc32(data[:place])
assert sorted(each.name for each in disk.rglob('*') if each.is_file()) == (
    ['bag.mcap', 'metadata.yaml'] if found else [])
print(len(found) * size)
"""
PLACE = ['unshare', '-Urm', 'mount', '-t', 'tmpfs', 'none', '/mnt']


@pytest.mark.skipif(subprocess.run(PLACE, capture_output=True, check=False).returncode != 0,
                    reason='no file system of its own may be mounted')
@pytest.mark.parametrize('size', [50, 3_000, 70_000, 400_000, 1_100_000, 3_900_000])
def test_what_came_before_the_disk_was_full_can_be_read(tmp_path, size):
    done = subprocess.run(
        ['unshare', '-Urm', 'sh', '-c', SCRIPT, 'sh', tmp_path, sys.executable, PROGRAM,
         str(size)], capture_output=True, text=True, check=True)
    error, kept = done.stdout.splitlines()
    assert 'No space left on device' in error
    if size < 100:
        assert int(kept) // size > 9_000  # an index of a mebibyte
    else:  # A mebibyte is kept free for the end, and at most a chunk is lost.
        assert int(kept) >= 4_000_000 - 2 ** 20 - 2 ** 20 - 2 * size
    assert error.endswith(f'the {int(kept) // size} messages that came before can be read'
                          if int(kept) else 'nothing is kept')


def test_an_interrupted_chunk_is_left_out(tmp_path, monkeypatch):
    """A second Ctrl-C, while the last chunk is compressed."""
    messages = [Recorded('/topic', 'std_msgs/msg/String', number, b'\0\1\0\0' + bytes(2 ** 20))
                for number in range(3)]

    def interrupted(*_):
        raise KeyboardInterrupt

    def come():
        yield from messages[:2]
        monkeypatch.setattr(zstandard, 'ZstdCompressor', interrupted)
        yield messages[2]

    with pytest.raises(KeyboardInterrupt):
        record(tmp_path / 'bag', come())
    monkeypatch.undo()
    assert list(read(tmp_path / 'bag')) == messages[:2]
    assert topics(tmp_path / 'bag')[0].messages == 2


def test_a_reserve_that_somebody_removed_does_not_matter(tmp_path):
    message = Recorded('/topic', 'std_msgs/msg/String', 1, bytes(9))
    with BagWriter(tmp_path / 'bag') as writer:
        writer.write(message)
        (tmp_path / 'bag' / '.room_for_the_summary').unlink()
    assert list(read(tmp_path / 'bag')) == [message]
