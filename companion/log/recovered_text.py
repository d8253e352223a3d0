"""What a recovered log lacks, and what it has from another log, as text for the user."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ..console import counted


def recovered_texts(lost: Sequence[str], borrowed: Mapping[str, str]) -> list[str]:
    """lost: places with causes. borrowed: topic -> the log from which its description was taken."""
    texts = []
    if lost:
        texts.append(
            f"the log was recovered from a damaged file; {counted(len(lost), 'place')} could not be read, the first: {lost[0]}. The "
            "results of the frames after it may differ from those in flight"
        )
    if borrowed:
        texts.append(
            f"{', '.join(borrowed)} {'is' if len(borrowed) == 1 else 'are'} from another log ({', '.join(sorted(set(borrowed.values())))}), "
            "as `companion recover --cameras-from` was asked: if its cameras differ, so do all distances and directions. "
            "`companion replay --check` compares the results with those in flight"
        )
    return texts
