"""The pictures of a test: found, checked by their headers, decoded ahead of their use."""

from __future__ import annotations

import re
import warnings
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from kiribench.errors import DatasetError, Fault

Float32Array = npt.NDArray[np.float32]

PICTURES = (".png", ".tif", ".tiff", ".jpg", ".jpeg")
VIDEOS = (".mp4", ".avi", ".mov", ".mkv")
CUT_OFF = 0.10
"""Share of pixels of the block at the top of the scale above which a frame is overexposed."""
_AHEAD = 3
_MAGIC = (b"\x89PNG", b"II*\x00", b"MM\x00*", b"\xff\xd8\xff\xe0", b"\xff\xd8\xff\xe1")


@dataclass(frozen=True)
class FrameList:
    """The pictures in their order.

    Attributes:
        names: of the frames. paths: of the pictures, or the one video.
        size_px: (width, height). video: whether the frames are those of a video.
        frame_rate_hz: of a video, else None. warnings: gaps in the numbers.
    """

    names: tuple[str, ...]
    paths: tuple[Path, ...]
    size_px: tuple[int, int]
    video: bool
    frame_rate_hz: float | None
    warnings: tuple[Fault, ...]


def list_frames(folder: Path, declared: tuple[str, ...] | None) -> FrameList:
    """Find and check the pictures of a folder, without decoding them.

    Args:
        folder: of the pictures, or of one video.
        declared: their names in order; None takes all, by the numbers in their names.

    Raises:
        DatasetError: with every fault found: ``frames-none``, ``frame-missing``,
            ``frame-twice``, ``frame-format``, ``frame-truncated``, ``frame-size``,
            ``frame-colour``.
    """
    if declared is not None:
        paths = [folder / name for name in declared]
    else:
        paths = sorted(
            (p for p in folder.iterdir() if p.suffix.lower() in PICTURES and p.is_file()),
            key=lambda path: [
                int(part) if part.isdigit() else part.lower()
                for part in re.split(r"(\d+)", path.name)
            ],
        )
        videos = sorted(p for p in folder.iterdir() if p.suffix.lower() in VIDEOS)
        if not paths and len(videos) == 1:
            return _video(videos[0])
    if len(paths) == 1 and paths[0].suffix.lower() in VIDEOS:
        return _video(paths[0])
    if len(paths) < 2:
        raise DatasetError(
            "frames-none",
            "There are fewer than two pictures.",
            remedy="Put the reference and at least one stretched picture (PNG, TIFF, JPEG), or "
            "one video, into the folder.",
            file=folder,
            got=len(paths),
            expected="2 or more",
        )
    faults: list[Fault] = []
    seen: dict[str, tuple[int, int]] = {}
    modes: dict[str, str] = {}
    for path in paths:
        wrong, size, mode = _header(path)
        faults += wrong
        if size is not None:
            if path.name in seen:
                faults.append(_fault("frame-twice", "A frame is listed twice.", path, "Once."))
            seen[path.name], modes[path.name] = size, mode
    if seen:
        sizes = list(seen.values())
        usual = max(set(sizes), key=sizes.count)
        for name, size in seen.items():
            if size != usual:
                faults.append(
                    _fault(
                        "frame-size",
                        "The picture has another size than the others.",
                        folder / name,
                        "Use the camera's own pictures, neither resized, cropped nor turned.",
                        f"{size[0]} x {size[1]} px",
                        f"{usual[0]} x {usual[1]} px",
                    )
                )
        kinds = list(modes.values())
        kind = max(set(kinds), key=kinds.count)
        for name, mode in modes.items():
            if mode != kind:
                faults.append(
                    _fault(
                        "frame-colour",
                        "The picture is not of the same kind as the others (colour, grey, depth).",
                        folder / name,
                        "Export every picture in the same way.",
                        mode,
                        kind,
                    )
                )
    if faults:
        raise DatasetError.of(faults)
    gaps = () if declared is not None else _gaps(paths)
    return FrameList(tuple(path.name for path in paths), tuple(paths), usual, False, None, gaps)


@contextmanager
def decoded(frames: FrameList) -> Iterator[Iterator[Float32Array]]:
    """The frames one after the other, (h, w) brightness, 0..255; decoded ahead in a thread.

    The thread, or the video, ends with the context. Left to the garbage collector it might end
    within the start of another thread, which would wait for it for ever.

    Raises:
        DatasetError: ``frame-unreadable``: the picture or the video cannot be decoded.
    """
    if frames.video:
        with closing(_decode_video(frames)) as pictures:
            yield pictures
        return
    with ThreadPoolExecutor(1) as pool, closing(_decode_ahead(pool, frames.paths)) as pictures:
        yield pictures


def _decode_ahead(
    pool: ThreadPoolExecutor, paths: Sequence[Path]
) -> Generator[Float32Array, None, None]:
    waiting: list[Future[Float32Array]] = []
    try:
        for path in paths:
            waiting.append(pool.submit(read_picture, path))
            if len(waiting) >= _AHEAD:
                yield waiting.pop(0).result()
        while waiting:
            yield waiting.pop(0).result()
    finally:
        for future in waiting:
            future.cancel()


def read_picture(path: Path) -> Float32Array:
    """(h, w) brightness of one picture, 0..255, also of 16-bit ones.

    Raises:
        DatasetError: ``frame-unreadable``.
    """
    import cv2

    levels = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH)
    if levels is None:
        raise DatasetError(
            "frame-unreadable",
            "The picture cannot be decoded.",
            remedy="Copy it again from the camera, or leave it out.",
            file=path,
        )
    if levels.dtype == np.uint16:
        return np.asarray(levels.astype(np.float32) / 257.0, dtype=np.float32)
    return np.asarray(levels, dtype=np.float32)


def check_exposure(
    picture: Float32Array, box: tuple[int, int, int, int], path: str, first_share: float | None
) -> float:
    """The share of cut-off pixels in a box (x0, y0, x1, y1).

    Args:
        picture: the frame. box: around the sheet. path: for the message.
        first_share: that of the first frame; a bright ground may be cut off in every frame.

    Raises:
        DatasetError: ``frame-overexposed``, ``frame-dark``.
    """
    x0, y0, x1, y1 = box
    part = picture[max(y0, 0) : y1 + 1, max(x0, 0) : x1 + 1]
    if part.size == 0:
        return 0.0
    share = float((part >= 254.5).mean())
    limit = CUT_OFF if first_share is None else max(CUT_OFF, 2 * first_share)
    if share > limit:
        raise DatasetError(
            "frame-overexposed",
            "The picture is overexposed: the sheet is cut off at white.",
            remedy="Expose so that the brightest paint stays below white; lock the exposure.",
            file=path,
            got=f"{100 * share:.0f} % of the block",
            expected=f"at most {100 * limit:.0f} %",
        )
    spread = float(np.percentile(part, 99.5) - np.percentile(part, 0.5))
    if spread < 8.0:
        raise DatasetError(
            "frame-dark",
            "The block shows next to no contrast.",
            remedy="Light the sheet evenly, and check the block's corners in tensile.json.",
            file=path,
            got=f"{spread:.0f} grey levels",
            expected="8 or more of 255",
        )
    return share


def _header(path: Path) -> tuple[list[Fault], tuple[int, int] | None, str]:
    from PIL import Image, UnidentifiedImageError

    if not path.is_file():
        return (
            [
                _fault(
                    "frame-missing",
                    "A frame that is listed is not there.",
                    path,
                    "Restore it, or take it from 'frames' in tensile.json.",
                )
            ],
            None,
            "",
        )
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of broken tags: what is broken is said below
            with Image.open(path) as picture:
                form, size, mode = picture.format, picture.size, picture.mode
                count = int(getattr(picture, "n_frames", 1))
    except (UnidentifiedImageError, OSError, SyntaxError, ValueError) as error:
        if path.read_bytes()[:4] in _MAGIC:
            return [_cut_short(path)], None, ""
        return (
            [
                _fault(
                    "frame-format",
                    "The file is no picture that can be read.",
                    path,
                    "Use PNG, TIFF or JPEG, and copy the file again from the camera.",
                    type(error).__name__,
                )
            ],
            None,
            "",
        )
    if form not in ("PNG", "TIFF", "JPEG", "MPO") or (count > 1 and form == "TIFF"):
        return (
            [
                _fault(
                    "frame-format",
                    "The file is not of a kind that is read here.",
                    path,
                    "Use PNG, JPEG or TIFF with one picture each.",
                    f"{form}, {count} pictures",
                )
            ],
            None,
            "",
        )
    if _truncated(path, str(form)):
        return [_cut_short(path)], size, mode
    return [], size, mode


def _cut_short(path: Path) -> Fault:
    return _fault(
        "frame-truncated",
        "The file ends before the picture does.",
        path,
        "Copy it again from the camera.",
        f"{path.stat().st_size} bytes",
    )


def _truncated(path: Path, form: str) -> bool:
    """Whether the end of the file is missing; OpenCV would fill in grey without a word."""
    size = path.stat().st_size
    with path.open("rb") as stream:
        stream.seek(max(0, size - 4096))
        tail = stream.read()
    if form == "PNG":
        return b"IEND" not in tail
    if form in ("JPEG", "MPO"):
        return b"\xff\xd9" not in tail
    from PIL import Image

    with Image.open(path) as picture:
        offsets = picture.tag_v2.get(273, ())  # type: ignore[attr-defined]
        counts = picture.tag_v2.get(279, ())  # type: ignore[attr-defined]
    return any(start + length > size for start, length in zip(offsets, counts, strict=False))


def _gaps(paths: list[Path]) -> tuple[Fault, ...]:
    """Numbers that are left out of an otherwise even series."""
    numbers = [[int(part) for part in re.findall(r"\d+", path.stem)] for path in paths]
    if len(numbers) < 4 or len({len(row) for row in numbers}) != 1 or not numbers[0]:
        return ()
    table = np.array(numbers)
    moving = np.flatnonzero(np.ptp(table, axis=0) > 0)
    if not len(moving):
        return ()
    series = table[:, moving[0]]
    steps = np.diff(series)
    usual = int(np.median(steps))
    wide = np.flatnonzero(steps > usual)
    if usual <= 0 or not len(wide) or len(wide) > max(1, 0.25 * len(steps)):
        return ()
    return tuple(
        Fault(
            "frame-gap",
            "The numbers of the frames skip; a picture may be missing.",
            "Restore it, or list the frames in tensile.json. Times by frame rate are refused.",
            file=str(paths[at]),
            got=f"{series[at + 1]} after {series[at]}",
            expected=f"steps of {usual}",
            severity="warning",
        )
        for at in wide
    )


def _video(path: Path) -> FrameList:
    import cv2

    stream = cv2.VideoCapture(str(path))
    try:
        count = int(stream.get(cv2.CAP_PROP_FRAME_COUNT)) if stream.isOpened() else 0
        size = (
            int(stream.get(cv2.CAP_PROP_FRAME_WIDTH)),
            int(stream.get(cv2.CAP_PROP_FRAME_HEIGHT)),
        )
        rate = float(stream.get(cv2.CAP_PROP_FPS))
    finally:
        stream.release()
    if count < 2:
        raise DatasetError(
            "video-unreadable",
            "The video cannot be read, or has fewer than two frames.",
            remedy="Convert it to H.264 in MP4, or to pictures.",
            file=path,
        )
    names = tuple(f"{path.name}#{k}" for k in range(count))
    return FrameList(names, (path,), size, True, rate if rate > 0 else None, ())


def _decode_video(frames: FrameList) -> Generator[Float32Array, None, None]:
    import cv2

    stream = cv2.VideoCapture(str(frames.paths[0]))
    try:
        for name in frames.names:
            there, picture = stream.read()
            if not there:
                raise DatasetError(
                    "frame-truncated",
                    "The video ends before its last frame.",
                    remedy="Copy it again from the camera, or cut it to what is whole.",
                    file=name,
                )
            yield np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), dtype=np.float32)
    finally:
        stream.release()


def _fault(
    code: str, what: str, path: Path, remedy: str, got: str | None = None, want: str | None = None
) -> Fault:
    return Fault(code, what, remedy, file=str(path), got=got, expected=want)
