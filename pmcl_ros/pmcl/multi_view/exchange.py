"""Views that show an object -> the two whose pictures were exchanged, which makes it wrong."""

from pmcl_ros.evidence.posed_evidence import ViewsEvidence
from pmcl_ros.lightfield.exchanged_pictures import exchanged_pictures
from pmcl_ros.pmcl.multi_view.found import Found

_FEW = 2  # views that agree on a wrong pose even if one of them was exchanged with another one
_ON_ARC = 3  # that do if those at the ends were exchanged: it is seen in the middle of the third


def exchanged_views(evidence: ViewsEvidence, found: Found) -> tuple[int, int] | None:
    """The two views, where what is around an object tells that a pose found in them is wrong.

    That is asked where few views show the object, or others do not: more views contradict the
    pose.
    """
    shown = [each.number for each in found.fits]
    if len(evidence.views) < 2 or (len(shown) > _ON_ARC and not found.estimate.hidden):
        return None
    among = range(len(evidence.views)) if len(shown) <= _FEW else shown
    pictures = evidence.pictures
    exchanged = None if pictures is None else exchanged_pictures(pictures)
    return exchanged if exchanged is not None and set(exchanged) <= set(among) else None
