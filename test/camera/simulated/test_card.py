"""What the simulated camera has stored."""

import json
import lzma
from datetime import datetime, timezone

import pytest
from simulated_cameras import SIDE, write_captures

from pmcl_ros.camera.files import write_picture
from pmcl_ros.camera.simulated import card as card_module
from pmcl_ros.camera.simulated.card import Card
from pmcl_ros.runtime.errors import CameraError

NOW = datetime(2031, 1, 2, 3, 4, 5, 678901, timezone.utc)


def test_raw_xz_and_lfp_are_served_unpacked(tmp_path, camera_text):
    text = camera_text(SIDE, SIDE)
    raws = write_captures(tmp_path, text)
    packed = tmp_path / 'capture1' / 'IMG.RAW'
    packed.with_name('IMG.RAW.xz').write_bytes(lzma.compress(packed.read_bytes()))
    packed.unlink()
    for each in (tmp_path / 'capture2').iterdir():
        each.unlink()
    write_picture(tmp_path / 'capture2' / 'IMG.LFP', raws[2], text)
    card = Card.from_folder(tmp_path)
    served = [card.file(each.path('RAW'))() for each in reversed(card.records)]
    assert served == raws
    single = Card.from_folder(tmp_path / 'capture1')
    assert single.records[0].number == 1


def test_pictures_of_a_card_are_the_same_after_a_restart(tmp_path, camera_text):
    write_captures(tmp_path, camera_text(SIDE, SIDE))
    assert Card.from_folder(tmp_path).records == Card.from_folder(tmp_path).records
    dates = [each.date for each in Card.from_folder(tmp_path).records]
    assert dates == sorted(dates, reverse=True)


def test_pictures_taken_have_their_own_ids_and_numbers(tmp_path, camera_text):
    write_captures(tmp_path, camera_text(SIDE, SIDE), 2)
    card = Card.from_folder(tmp_path, empty=True)
    assert card.records == []
    for _ in range(5):
        card.store(*card.expose(NOW))
    assert [each.number for each in card.records] == [5, 4, 3, 2, 1]
    assert len({each.id for each in card.records}) == 5
    assert card.records[0].date == '2031-01-02T03:04:05.678Z'
    assert card.delete(card.records[1].key).number == 4
    assert card.delete(b'x' * 24) is None
    assert card.file(r'I:\DCIM\100PHOTO\IMG_0004.RAW') is None
    card.store(*card.expose(NOW))
    assert [each.number for each in card.records] == [6, 5, 3, 2, 1]  # no number comes twice


def test_many_pictures_go_into_the_next_folder(tmp_path, camera_text, monkeypatch):
    monkeypatch.setattr(card_module, 'FILES_PER_FOLDER', 2)
    write_captures(tmp_path, camera_text(SIDE, SIDE), 3)
    assert [(each.folder, each.number) for each in Card.from_folder(tmp_path).records] == [
        (101, 1), (100, 2), (100, 1)]


def test_white_images_alone_are_pictures_too(tmp_path, camera_text):
    frame = {'metadata': json.loads(camera_text(SIDE, SIDE))}
    text = json.dumps({'master': {'picture': {
        'frameArray': [{'frame': frame}],
        'parameters': {'vendorContent': {'com.lytro.tags': {'modulationFrame': True}}}}}})
    raws = write_captures(tmp_path, text, 1)
    card = Card.from_folder(tmp_path)
    assert card.file(card.records[0].path('RAW'))() == raws[0]
    assert card.file('C:\\T1CALIB\\MOD_0000.RAW')() == raws[0]


def test_a_folder_without_pictures_is_refused(tmp_path):
    with pytest.raises(CameraError, match=r'no .*picture in'):
        Card.from_folder(tmp_path)
