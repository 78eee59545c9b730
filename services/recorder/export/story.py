"""What a film says of a moment."""

from services.recorder.export.caption import Caption
from services.recorder.export.framing import num_drawn
from services.recorder.export.moment import Moment


def story(moment: Moment) -> Caption:
    """Return time, quality and counts, as far as they were recorded."""
    told: Caption = [("t", f"{moment.elapsed_s:.1f} s", "100.0 s")]
    if moment.poses:
        told.append(("cameras", str(len(moment.poses)), "00"))
    if moment.mirror.latest is not None:
        told.append(("voxels", f"{num_drawn(moment):,}", "00,000"))
    if moment.quality is not None:
        score = moment.quality.stamp_true[1]
        told.append(("coverage", f"{100 * score.coverage:.1f} %", "100.0 %"))
        told.append(("F-score", f"{100 * score.f_score:.1f} %", "100.0 %"))
    return told
