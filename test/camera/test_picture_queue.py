"""Which pictures are still to be published."""

import pytest
from simulated_cameras import SIDE, write_captures

from pmcl_ros.camera.client import PictureQueue
from pmcl_ros.camera.sources import CameraSettings, FileCamera, open_camera
from pmcl_ros.runtime.errors import SettingsError


@pytest.fixture
def camera(tmp_path, camera_text):
    write_captures(tmp_path, camera_text(SIDE, SIDE))
    return FileCamera(tmp_path)


def test_what_was_there_before_is_not_waiting_what_comes_is_until_it_is_done(camera):
    camera.capture()
    queue = PictureQueue(camera)
    assert queue.waiting() == []
    taken = [camera.capture(), camera.capture()]
    assert queue.waiting() == queue.waiting() == taken
    queue.done(taken[0])
    assert queue.waiting() == taken[1:]


def test_a_picture_that_is_none_is_given_up_at_the_third_time(camera):
    queue = PictureQueue(camera)
    bad, good = camera.capture(), camera.capture()
    assert [queue.failed(bad) for _ in range(2)] == [False, False]
    assert queue.waiting() == [bad, good]
    assert queue.failed(bad)
    assert queue.waiting() == [good]


def test_files_in_a_loop_take_no_more_memory_and_lose_no_picture(tmp_path, camera_text):
    raws = write_captures(tmp_path, camera_text(SIDE, SIDE))
    camera = FileCamera(tmp_path, loop=True)
    queue = PictureQueue(camera)
    for number in range(1, 1001):
        picture = camera.capture()
        assert picture.id.startswith(f'{number} ')
        assert queue.waiting() == [picture]
        queue.done(picture)
    kept = camera.pictures()
    assert len(kept) == 100
    assert [camera.fetch(each)[0] for each in kept[-3:]] == [raws[1], raws[2], raws[0]]


def test_a_gateway_is_not_asked_to_delete():
    settings = CameraSettings(source='gateway', gateway='http://127.0.0.1:9', delete=True)
    with pytest.raises(SettingsError, match='deletes no pictures'):
        open_camera(settings)
