"""What listed objects are called."""

import re
from collections import Counter
from collections.abc import Hashable, Sequence

from pmcl_ros.runtime.errors import LocalizationError


def distinct_names(names: Sequence[str], kinds: Sequence[Hashable] = ()) -> list[str]:
    """Names of listed objects, copies numbered from 2 on: `glass`, `glass_2`.

    kinds: which object each is a copy of; by default as the names say.
    Letters, digits and underscores alone, as ROS takes them in topics, a letter first. Raises
    LocalizationError when the list is empty or two objects would be called the same.
    """
    if not names:
        raise LocalizationError('no objects are listed: name one at least')
    count: Counter[Hashable] = Counter()
    made = []
    for each, kind in zip(names, kinds or names, strict=True):
        plain = re.sub(r'_*[^0-9a-zA-Z_]+_*|__+', '_', each).strip('_')
        plain = plain if plain[:1].isalpha() else f'object_{plain}'.rstrip('_')
        count[kind] += 1
        made.append(plain if count[kind] == 1 else f'{plain}_{count[kind]}')
    for each, times in Counter(made).items():
        if times > 1:
            alike = [name for name, one in zip(names, made, strict=True) if one == each]
            raise LocalizationError(f'objects {alike} would all be called {each!r}: rename the '
                                    'file of one')
    return made
