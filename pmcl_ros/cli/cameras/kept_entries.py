"""What somebody added to a views.yaml, as masks, stays when it is written anew."""

from pathlib import Path
from typing import Any

from pmcl_ros.lightfield.readers.posed_views import ViewsFile
from pmcl_ros.runtime.errors import SettingsError


def read_earlier(path: Path) -> ViewsFile | None:
    """The views.yaml that is there; None: there is none. Raises SettingsError for a wrong one."""
    if not path.exists():
        return None
    try:
        return ViewsFile.load(path)
    except SettingsError as error:
        raise SettingsError(f'{error}: what it says is kept; mend it, or remove it') from None


def with_kept(values: dict[str, Any], earlier: ViewsFile | None) -> dict[str, Any]:
    """The values of a views.yaml, and what the earlier one says beside them.

    That is of the file, of its cameras and of its pictures: keys that `values` does not have.
    """
    if earlier is None:
        return values
    before = earlier.model_dump(mode='json', exclude_unset=True)
    of_camera = before.get('cameras', {})
    of_view = {each['file']: each for each in before['views']}
    cameras = {name: _both(each, of_camera.get(name, {}))
               for name, each in values['cameras'].items()}
    views = [_both(each, of_view.get(each['file'], {})) for each in values['views']]
    return _both(values, before) | {'cameras': cameras, 'views': views}


def _both(new: dict[str, Any], before: dict[str, Any]) -> dict[str, Any]:
    return new | {name: each for name, each in before.items() if name not in new}
