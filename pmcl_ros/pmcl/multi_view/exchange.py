"""Views that show an object -> the order of their poses that fits, if not theirs: it is wrong."""

from pmcl_ros.evidence.posed_evidence import ViewsEvidence
from pmcl_ros.lightfield.exchanged_pictures import right_order
from pmcl_ros.pmcl.multi_view.found import Found

_FEW = 2  # views that agree on a wrong pose even if one of them was exchanged with another one
_ON_ARC = 3  # that do if those at the ends were exchanged: it is seen in the middle of the third


def order_of_views(evidence: ViewsEvidence, found: Found) -> tuple[int, ...] | None:
    """As `right_order`, where what is around an object tells that a pose found in them is wrong.

    That is asked where few views show the object, or others do not: more views contradict the
    pose. Two exchanged views do not matter where others alone show it; a shift is of all.
    """
    shown = [each.number for each in found.fits]
    if len(evidence.views) < 2 or (len(shown) > _ON_ARC and not found.estimate.hidden):
        return None
    among = range(len(evidence.views)) if len(shown) <= _FEW else shown
    pictures = evidence.pictures
    order = None if pictures is None else right_order(pictures)
    moved = [] if order is None else [k for k, other in enumerate(order) if other != k]
    return order if len(moved) > 2 or set(moved) <= set(among) else None
