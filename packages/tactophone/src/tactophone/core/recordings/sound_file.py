"""Sound files as recorders, phones and copies leave them: what a header claims is
compared with what the file holds.

A header is written first and corrected last. A recorder that lost its power, a pipe
that could not seek and a copy that stopped half-way leave a header that claims too
little, nothing, or too much. Here a file is read to the end of what it holds, and
`open_file` is the only place that opens one for reading.

The containers that know their length are walked by hand, because libsndfile corrects a
length in silence (WAV and its kin), or believes it and fails at the end (FLAC).
"""

import io
import math
import os
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, NoReturn

import numpy as np
import soundfile
from numpy.typing import NDArray

from tactophone.core.errors import DatasetError
from tactophone.core.recordings.c_stderr import without_c_stderr

SOUND_SUFFIXES = frozenset(
    {
        ".aif",
        ".aifc",
        ".aiff",
        ".amb",
        ".au",
        ".bwf",
        ".caf",
        ".flac",
        ".iff",
        ".mp3",
        ".nist",
        ".oga",
        ".ogg",
        ".opus",
        ".paf",
        ".rf64",
        ".snd",
        ".sph",
        ".voc",
        ".w64",
        ".wav",
        ".wave",
    }
)
"""File names that end like this are taken for sound, in capitals too."""

FFMPEG_SUFFIXES = frozenset(
    {
        ".3gp",
        ".aac",
        ".ac3",
        ".amr",
        ".ape",
        ".avi",
        ".dsf",
        ".m4a",
        ".m4b",
        ".m4v",
        ".mka",
        ".mkv",
        ".mov",
        ".mp4",
        ".tta",
        ".webm",
        ".wma",
        ".wv",
    }
)
"""Sound that phones, cameras and players write and libsndfile cannot read."""

FILE_HIGHEST_RATE = 768_000
"""Hz, the highest rate of sound cards. What a header states beyond it would take
gigabytes for the filters of a resampler."""

ICLOUD_SUFFIX = ".icloud"
"""Ending of the hidden placeholder of a file that a Mac keeps in the cloud alone."""

LEAST_LOST = 0.05
"""Seconds that must be missing at a file's end to be called a part of the sound. What a
recorder or a converter rounds is less, and the rest is whole."""


@dataclass(frozen=True, slots=True)
class Length:
    """How long a file's header says that its sound is, and how long it is.

    Attributes
    ----------
    claimed
        By the header; 0 where it leaves the length open, as pipes do.
    held
        Found in the file. Both are in samples for FLAC and in bytes for all others, so
        only their ratio has a meaning of its own.
    closed
        False for a stream that ends without the mark of its end, which states no
        length.
    """

    claimed: int
    held: int
    closed: bool = True

    @property
    def share(self) -> float:
        """Share of the claimed sound that the file holds, 0 to 1.

        >>> Length(claimed=400, held=100).share, Length(claimed=0, held=100).share
        (0.25, 1.0)
        """
        return min(1.0, self.held / self.claimed) if self.claimed else 1.0

    @property
    def cut(self) -> bool:
        """Whether a part of the sound is missing."""
        return self.share < 1.0 or not self.closed

    def lost(self, duration: float) -> float:
        """Return how many seconds are missing, where what is there lasts ``duration``
        s; infinite where that is unknown."""
        if not self.closed or not self.held:
            return math.inf
        return duration / self.share - duration

    def words(self, duration: float) -> str:
        """Say what is missing, where what is there lasts ``duration`` s."""
        if not self.held:
            return "holds a header and no sound"
        if not self.closed:
            return f"breaks off after {duration:.1f} s, without the mark of its end"
        if (lost := self.lost(duration)) < LEAST_LOST:
            return f"lacks the last {1000 * lost:.1f} ms that its header claims"
        return (
            f"ends after {duration:.1f} of {duration / self.share:.1f} s, "
            "so it was not copied or saved whole"
        )


@dataclass(frozen=True, slots=True)
class _Container:
    """What walking through a container found."""

    length: Length
    corrections: tuple[tuple[int, bytes], ...] = ()
    """Bytes of the header that libsndfile must see differently, by their place."""
    head: bytes = b""
    """What it must see in place of the first ``begin`` bytes."""
    begin: int = 0


def open_file(path: Path) -> soundfile.SoundFile:
    """Open a sound file for reading to the end of what it holds.

    Raises `DatasetError` if there is no such file, or it cannot be read as sound.
    """
    if not path.is_file():
        kind = "a folder" if path.is_dir() else "no such file"
        raise DatasetError(f"{path}: {kind}; give a WAV or FLAC recording")
    try:
        found = _walk_file(path)
        sound: Any = native_name(path)
        if found.corrections:
            sound = io.BufferedReader(_CorrectedFile(path, found.corrections))
        elif found.head:
            sound = io.BufferedReader(_FileWithHead(path, found.head, found.begin))
        opened = _SoundFile(sound)
    except (soundfile.SoundFileError, OSError) as error:
        reason = str(getattr(error, "error_string", error)).strip().rstrip(".")
        kind, step = _content(path) if path.stat().st_size else ("", "")
        raise DatasetError(
            f"{path}: cannot be read as sound ({kind or reason}); "
            f"{step or _next_step(path)}"
        ) from error
    if opened.samplerate > FILE_HIGHEST_RATE:
        opened.close()
        refuse_rate(opened.samplerate, str(path))
    return opened


def refuse_rate(rate: float, name: str) -> NoReturn:
    """Raise the `DatasetError` for sound of a higher rate than `FILE_HIGHEST_RATE`."""
    raise DatasetError(
        f"{name}: {rate:g} Hz, but {FILE_HIGHEST_RATE} Hz or less is needed; convert "
        "it, or correct the rate in its header"
    )


class _SoundFile(soundfile.SoundFile):  # type: ignore[misc]
    """A sound file whose blocks end where its sound ends.

    Where a decoder yields less than the header claims, the blocks of `soundfile` go on
    to the claimed length with what was in memory: the last block again and again.
    Nothing but errors says what is odd in a file: its decoder prints nothing.
    """

    def __init__(self, file: bytes | Path | BinaryIO) -> None:
        with without_c_stderr():
            super().__init__(file)

    def read(self, *args: Any, **options: Any) -> NDArray[Any]:
        with without_c_stderr():
            samples: NDArray[Any] = super().read(*args, **options)
        return samples

    def seek(self, frames: int, whence: int = io.SEEK_SET) -> int:
        with without_c_stderr():
            return int(super().seek(frames, whence))

    def blocks(
        self,
        blocksize: int | None = None,
        overlap: int = 0,
        frames: int = -1,
        dtype: str = "float64",
        always_2d: bool = False,
        fill_value: float | None = None,
        out: NDArray[Any] | None = None,
    ) -> Iterator[NDArray[Any]]:
        if blocksize is None or overlap or fill_value is not None or out is not None:
            raise TypeError("only blocks of a size, one after another, are read here")
        left = self.frames - self.tell() if frames < 0 else frames
        while left > 0:
            samples = self.read(min(blocksize, left), dtype, always_2d)
            if not len(samples):
                return
            yield samples
            left -= len(samples)


WHOLE_BLOCK = 1 << 16
"""Samples that are read at a time of a sound that is read as a whole."""


LARGEST_WAV = 0xFFFFFFFF - (1 << 16)
"""Bytes of sound in a WAV file, whose sizes have 32 bits: most programs never read
what lies beyond."""

_DOWNGRADE = 0x1210
"""The command SFC_RF64_AUTO_DOWNGRADE of libsndfile."""


def create_long_wav(
    path: Path, *, sample_rate: int, channels: int, subtype: str
) -> soundfile.SoundFile:
    """Create a WAV file for sound of any length: RF64 from 4 GB on, which libsndfile,
    ffmpeg and Audacity read, too."""
    file = soundfile.SoundFile(
        native_name(path), "w", sample_rate, channels, subtype, format="RF64"
    )
    # `soundfile` has no method for it.
    soundfile._snd.sf_command(file._file, _DOWNGRADE, soundfile._ffi.NULL, 1)
    return file


def read_samples(file: soundfile.SoundFile, *, frames: int = -1) -> NDArray[np.float32]:
    """Return the next ``frames`` samples of an open file, or all; shape ``(frames,
    channels)``.

    It reads block by block, as `SoundFile.read` would allocate whatever the header
    claims.
    """
    blocks = file.blocks(WHOLE_BLOCK, frames=frames, dtype="float32", always_2d=True)
    nothing = np.zeros((0, file.channels), np.float32)
    return np.concatenate([nothing, *blocks])


def read_content(content: bytes, name: str) -> tuple[NDArray[np.float32], int, Length]:
    """Return the samples, the rate and the length of a sound file in memory, as from
    disk.

    Raises `DatasetError`, with ``name`` for the file, if it cannot be read as sound.
    """
    container = _walk(io.BytesIO(content), len(content))
    corrected = bytearray(container.head + content[container.begin :])
    for place, correction in container.corrections:
        corrected[place : place + len(correction)] = correction
    try:
        with _SoundFile(io.BytesIO(corrected)) as file:
            if file.samplerate > FILE_HIGHEST_RATE:
                refuse_rate(file.samplerate, name)
            return read_samples(file), int(file.samplerate), container.length
    except (soundfile.SoundFileError, ValueError) as error:
        reason = str(getattr(error, "error_string", error)).strip().rstrip(".")
        raise DatasetError(
            f"{name}: cannot be read as sound ({reason}); give a WAV or FLAC file, "
            "open at its beginning"
        ) from error


def native_name(path: Path) -> bytes | Path:
    """Return a path as `soundfile` takes it, which refuses names that are no UTF-8 but
    takes their bytes."""
    return path if os.name == "nt" else os.fsencode(path)


def text_name(path: Path) -> Path:
    r"""Return a name that every system can write: a byte that is no UTF-8 becomes
    ``%`` and two digits.

    >>> text_name(Path("gr\udcfcn.wav")).name
    'gr%FCn.wav'
    """
    return Path(
        "".join(
            f"%{ord(char) - 0xDC00:02X}" if "\udc80" <= char <= "\udcff" else char
            for char in str(path)
        )
    )


def length_of(path: Path) -> Length:
    """Compare the length that a file's header claims with what the file holds.

    A file without a length of its own, such as MP3 of some encoders, or of an unknown
    kind, is taken as whole. Raises `OSError` if it cannot be read.
    """
    return _walk_file(path).length


@dataclass(frozen=True, slots=True)
class SoundInfo:
    """What a sound file is, without its sound."""

    sample_rate: int
    channels: int
    size: int
    """Samples that the file holds."""

    @property
    def duration(self) -> float:
        """Length, in s."""
        return self.size / self.sample_rate


def sound_info(path: Path) -> SoundInfo:
    """Return rate, channels and length of a file; errors as `open_file`."""
    with open_file(path) as file:
        return SoundInfo(int(file.samplerate), int(file.channels), int(file.frames))


def is_hidden(path: Path, folder: Path) -> bool:
    """Return whether a file below a folder belongs to the system that copied it, not to
    the data.

    Names that begin with a dot are hidden (a Mac's ``._take.wav``, a cache of some
    program); ``__MACOSX`` holds the same in archives.

    >>> folder = Path("d")
    >>> is_hidden(Path("d/__MACOSX/a.wav"), folder), is_hidden(Path("d/a.wav"), folder)
    (True, False)
    """
    parts = path.relative_to(folder).parts
    return any(part.startswith(".") or part == "__MACOSX" for part in parts)


def ffmpeg_command(path: Path) -> str:
    """Return the command that makes a WAV file of what libsndfile cannot read."""
    return f"ffmpeg -i {path.name} {path.stem}.wav"


_FFMPEG = "convert it: `ffmpeg -i {name} {stem}-converted.wav`"

_CONTENTS: tuple[tuple[int, bytes, str, str], ...] = (
    (4, b"ftyp", "MPEG-4, whatever its name says", _FFMPEG),
    (0, b"\x1a\x45\xdf\xa3", "Matroska or WebM, whatever its name says", _FFMPEG),
    (0, b"#!AMR", "AMR, whatever its name says", _FFMPEG),
    (0, b"\x30\x26\xb2\x75", "Windows Media, whatever its name says", _FFMPEG),
    (0, b"version https://git-lfs", "a pointer of Git LFS", "fetch it: `git lfs pull`"),
    (0, b"<", "a web page or XML", "the download failed; fetch it again"),
    (0, b"PK\x03\x04", "an archive", "unpack it"),
    (0, b"bplist", "a placeholder of iCloud", "download it in the Finder"),
    (0, bytes(64), "nothing but zeros at its start", "copy it again"),
)
"""What else a file is that is called a sound: where it begins with which bytes, what
that means, and what to do."""


def _content(path: Path) -> tuple[str, str]:
    """Return what a file is, by its first bytes, and what to do with it; empty where
    they say no more than its name."""
    if path.suffix.lower() in FFMPEG_SUFFIXES:
        return "", ""
    with path.open("rb") as file:
        head = file.read(64)
    for place, content, kind, step in _CONTENTS:
        if head[place:].startswith(content):
            return kind, step.format(name=path.name, stem=path.stem)
    return "", ""


def _next_step(path: Path) -> str:
    if path.suffix.lower() in FFMPEG_SUFFIXES:
        return f"convert it: `{ffmpeg_command(path)}`"
    if not path.stat().st_size:
        return "it has 0 bytes; copy it again"
    if path.name.startswith("._"):
        return "it is a Mac's note on another file; leave it out"
    return "give a WAV or FLAC file, or restore this one"


class _CorrectedFile(io.FileIO):
    """A file in which some bytes of the header read differently."""

    def __init__(self, path: Path, corrections: tuple[tuple[int, bytes], ...]) -> None:
        super().__init__(os.fsencode(path))
        self._corrections = corrections

    def readinto(self, buffer: object, /) -> int:
        view = memoryview(buffer).cast("B")  # type: ignore[arg-type]
        start = self.tell()
        count = super().readinto(view) or 0
        for place, content in self._corrections:
            first = max(place, start)
            last = min(place + len(content), start + count)
            if first < last:
                view[first - start : last - start] = content[
                    first - place : last - place
                ]
        return count


class _FileWithHead(io.FileIO):
    """A file whose first ``begin`` bytes read as a head of another length."""

    def __init__(self, path: Path, head: bytes, begin: int) -> None:
        super().__init__(os.fsencode(path))
        self._head = head
        self._begin = begin
        self._place = 0

    def tell(self) -> int:
        return self._place

    def seek(self, offset: int, whence: int = io.SEEK_SET, /) -> int:
        if whence == io.SEEK_CUR:
            offset += self._place
        elif whence == io.SEEK_END:
            end = super().seek(0, io.SEEK_END)
            offset += end - self._begin + len(self._head)
        self._place = offset
        return offset

    def readinto(self, buffer: object, /) -> int:
        view = memoryview(buffer).cast("B")  # type: ignore[arg-type]
        if content := self._head[self._place : self._place + len(view)]:
            count = len(content)
            view[:count] = content
        else:
            super().seek(self._place - len(self._head) + self._begin)
            count = super().readinto(view) or 0
        self._place += count
        return count


def _walk_file(path: Path) -> _Container:
    with path.open("rb") as file:
        return _walk(file, path.stat().st_size)


def _walk(file: BinaryIO, size: int) -> _Container:
    """Find the sound in a container by its first bytes; what is unknown is whole."""
    head = file.read(16)
    if head[:4] in (b"RIFF", b"RIFX", b"RF64", b"BW64"):
        return _walk_riff(file, head, size)
    if head[:4] == b"FORM" and head[8:12] in (b"AIFF", b"AIFC"):
        return _walk_aiff(file, size)
    if head[:4] == b"riff":
        return _walk_w64(file, size)
    if head[:4] == b"caff":
        return _walk_caf(file, size)
    if head[:4] == b".snd":
        return _walk_au(head, size)
    if head[:4] == b"fLaC":
        return _walk_flac(file, size)
    if head[:4] == b"OggS":
        return _walk_ogg(file, size)
    if head[:3] == b"ID3" or head[:1] == b"\xff":
        return _walk_mp3(file, size)
    return _Container(Length(size, size))


OPEN_SIZES = frozenset({0, 0xFFFFFFFF, 0xFFFFFFFFFFFFFFFF})
"""Sizes of a program that could not go back to the header: none yet, or the largest."""

LARGEST_PIPED = 0x7FFF0000
"""From this size on, in 32 bits, a header was written by a program that did not know
the length: sox writes 0x7FFFFFFF less its header, and others round it."""


def _is_open(claimed: int, held: int, *, bits: int = 32) -> bool:
    if claimed in OPEN_SIZES:
        return True
    return bits == 32 and claimed >= LARGEST_PIPED > held


def _walk_riff(file: BinaryIO, head: bytes, size: int) -> _Container:
    """WAV, and its kin of more than 4 GB, whose chunk ``ds64`` has the true size."""
    order = ">" if head[:4] == b"RIFX" else "<"
    large = 0
    large_at = 0
    form = b""
    for name, place, short in _chunks(file, 12, size, f"{order}4sI", padding=2):
        if name == b"ds64":
            file.seek(place)
            large = struct.unpack("<QQ", file.read(16).ljust(16, b"\0"))[1]
            large_at = place + 8
        if name == b"fmt ":
            file.seek(place)
            form = file.read(min(short, LONGEST_FORMAT))
        if name == b"data":
            held = size - place
            if head[:4] == b"RIFF" and _is_over(short, held):
                return _Container(Length(0, held), (), _rf64(form, held), place)
            claimed = large if short == 0xFFFFFFFF and large else short
            if not _is_open(claimed, held):
                return _Container(Length(claimed, min(claimed, held)))
            # libsndfile takes a size of 0 for no sound.
            known = min(held, 0xFFFFFFFE)
            if large_at and not large and held:
                # A recorder of long files that lost its power, or a pipe.
                sizes = struct.pack("<QQ", size - 8, held)
                return _Container(Length(0, held), ((large_at - 8, sizes),))
            lost = claimed == 0 and held > 0
            content = struct.pack(f"{order}I", known)
            return _Container(Length(0, held), ((place - 4, content),) if lost else ())
    return _Container(Length(0, 0))


LARGEST_RIFF = 0xFFFFFFFF
"""Bytes that the header of a WAV file can state."""

LONGEST_FORMAT = 1 << 10
"""Bytes of the chunk ``fmt`` that are read; it has 40 at most in sound without a
codec."""


def _is_over(claimed: int, held: int) -> bool:
    """Return whether more follows than a header of 32 bits can state: it has the
    largest size then, or what is left of the true one."""
    return held > LARGEST_RIFF and (
        claimed in OPEN_SIZES or held - claimed > LARGEST_RIFF
    )


def _rf64(form: bytes, held: int) -> bytes:
    """Return the head of a WAV file of over 4 GB, up to its sound (EBU Tech 3306)."""
    form = struct.pack("<4sI", b"fmt ", len(form)) + form
    data = struct.pack("<4sI", b"data", LARGEST_RIFF)
    whole = len(b"WAVE") + 36 + len(form) + len(data) + held
    sizes = struct.pack("<4sIQQQI", b"ds64", 28, whole, held, 0, 0)
    head = struct.pack("<4sI4s", b"RF64", LARGEST_RIFF, b"WAVE")
    return head + sizes + form + data


def _walk_aiff(file: BinaryIO, size: int) -> _Container:
    for name, place, claimed in _chunks(file, 12, size, ">4sI", padding=2):
        if name == b"SSND":
            held = size - place
            if _is_open(claimed, held):
                return _Container(Length(0, held))
            return _Container(Length(claimed, min(claimed, held)))
    return _Container(Length(0, 0))


def _walk_w64(file: BinaryIO, size: int) -> _Container:
    # A chunk's size counts its own head of 24 bytes here.
    for name, place, claimed in _chunks(file, 40, size, "<16sQ", padding=8, own=24):
        if name[:4] == b"data":
            return _Container(Length(claimed, min(claimed, size - place)))
    return _Container(Length(0, 0))


def _walk_caf(file: BinaryIO, size: int) -> _Container:
    for name, place, claimed in _chunks(file, 8, size, ">4sQ", padding=1):
        if name == b"data":
            held = size - place
            if _is_open(claimed, held, bits=64):
                return _Container(Length(0, held))
            if claimed <= held:
                return _Container(Length(claimed, claimed))
            # libsndfile refuses the file for its size.
            correction = (place - 8, struct.pack(">Q", held))
            return _Container(Length(claimed, held), (correction,))
    return _Container(Length(0, 0))


def _walk_au(head: bytes, size: int) -> _Container:
    offset, claimed = struct.unpack(">II", head[4:12].ljust(8, b"\0"))
    held = max(0, size - offset)
    if _is_open(claimed, held):
        return _Container(Length(0, held))
    return _Container(Length(claimed, min(claimed, held)))


MP3_FIRST = 1 << 12
"""Bytes in which the first frame of an MP3 file begins, after its tags."""

XING_BYTES = 0x02
"""Flag of a Xing header that states how many bytes the frames have."""


def _walk_mp3(file: BinaryIO, size: int) -> _Container:
    """MP3, whose first frame may say how many bytes there are (the header of Xing, and
    of LAME, which most encoders write)."""
    file.seek(0)
    tag = file.read(10)
    begin = 0
    if tag[:3] == b"ID3":
        # Seven bits of each byte, so that no tag looks like a frame.
        parts = (byte & 0x7F for byte in tag[6:10])
        begin = 10 + sum(part << 7 * (3 - at) for at, part in enumerate(parts))
    file.seek(begin)
    first = file.read(MP3_FIRST)
    for name in (b"Xing", b"Info"):
        place = first.find(name, 0, 4 + 32 + 4)
        flags = first[place + 7 : place + 8]
        if place < 0 or not flags or not flags[0] & XING_BYTES:
            continue
        # The number of frames stands before the number of bytes, where it is stated.
        at = place + 8 + (4 if flags[0] & 1 else 0)
        claimed = int.from_bytes(first[at : at + 4], "big")
        held = size - begin
        if held >= claimed:
            return _Container(Length(claimed, claimed))
        # Without the header's name its numbers are not believed.
        correction = (begin + place, bytes(4))
        return _Container(Length(claimed, held), (correction,))
    return _Container(Length(size, size))


OGG_PAGE = 1 << 16
"""Bytes at the end in which the head of the last page is looked for; a page has at most
65,307 (RFC 3533, section 6)."""

OGG_END = 0x04
"""Flag of a stream's last page, in the sixth byte of its head."""


def _walk_ogg(file: BinaryIO, size: int) -> _Container:
    file.seek(max(0, size - OGG_PAGE))
    tail = file.read()
    last = tail.rfind(b"OggS")
    closed = 0 <= last < len(tail) - 5 and bool(tail[last + 5] & OGG_END)
    return _Container(Length(size, size, closed))


MOST_CHUNKS = 10_000
"""Chunks of a file that are walked through; recorders write a dozen."""


def _chunks(
    file: BinaryIO,
    place: int,
    size: int,
    layout: str,
    *,
    padding: int,
    own: int = 0,
) -> Iterator[tuple[bytes, int, int]]:
    """Yield the name of each chunk, where its content begins and its size."""
    head_size = struct.calcsize(layout)
    for _ in range(MOST_CHUNKS):
        if place + head_size > size:
            return
        file.seek(place)
        name, claimed = struct.unpack(layout, file.read(head_size))
        content = max(0, claimed - own)
        yield name, place + head_size, content
        place += head_size + content
        place += -place % padding


FLAC_TOTAL = 21
"""Place of the five bytes whose last 36 bits are the number of samples: STREAMINFO is
the first block of every FLAC file (RFC 9639, section 8.2)."""

FLAC_MOST = (1 << 36) - 1
"""Most samples that STREAMINFO can state."""

FLAC_TAIL = 1 << 20
"""Bytes at the end in which the last frame is looked for. A frame of 65,535 samples of
two channels in 24 bits has under 400 kB."""


def _walk_flac(file: BinaryIO, size: int) -> _Container:
    """FLAC, whose last frame says how many samples come before it."""
    file.seek(FLAC_TOTAL)
    packed = int.from_bytes(file.read(5).ljust(5, b"\0"), "big")
    claimed = packed & FLAC_MOST
    file.seek(8)
    largest = int.from_bytes(file.read(4)[2:4], "big")
    begin = _end_of_metadata(file)
    start = max(begin, size - FLAC_TAIL)
    file.seek(begin)
    first = file.read(4)
    file.seek(start)
    held = _samples_held(file.read(), first, largest, claimed)
    if held is None or held == claimed:
        known = claimed if held is None else held
        return _Container(Length(claimed, known))
    total = (packed & ~FLAC_MOST) | held
    correction = (FLAC_TOTAL, total.to_bytes(5, "big"))
    return _Container(Length(claimed, held), (correction,))


def _end_of_metadata(file: BinaryIO) -> int:
    place = 4
    for _ in range(MOST_CHUNKS):
        file.seek(place)
        head = file.read(4)
        if len(head) < 4:
            break
        place += 4 + int.from_bytes(head[1:], "big")
        if head[0] & 0x80:  # the last block
            break
    return place


def _samples_held(tail: bytes, first: bytes, largest: int, claimed: int) -> int | None:
    """Return how many samples a FLAC file holds, by the end of it; ``None`` if no frame
    is found there."""
    if first[:1] != b"\xff" or len(first) < 4:
        return None
    place = len(tail)
    while (place := tail.rfind(first[:2], 0, place)) >= 0:
        frame = _frame_at(tail, place, first, largest)
        if frame is None:
            continue
        before, count = frame
        whole = _crc(tail[place:-2], bits=16) == int.from_bytes(tail[-2:], "big")
        # Players append tags, which belong to no frame.
        tagged = before + count == claimed and tail[-128:-125] == b"TAG"
        return before + count if whole or tagged else before
    return None


def _frame_at(
    tail: bytes, place: int, first: bytes, largest: int
) -> tuple[int, int] | None:
    """Return how many samples lie before a frame and how many it has; ``None`` if no
    frame begins there.

    The second half of a header's sync code may occur within sound. So rate, channels
    and sample size must be possible, the rate and size as in the first frame, and the
    header's checksum must hold. No file has more than `FLAC_MOST` samples.
    """
    head = tail[place : place + 16]
    if len(head) < 6 or (head[2] & 0x0F) != (first[2] & 0x0F):
        return None
    if (head[3] & 0x0F) != (first[3] & 0x0F) or head[3] >> 4 > 10:
        return None
    number, used = _coded_number(head[4:])
    if not used:
        return None
    end = 4 + used
    code = head[2] >> 4
    if code == 6:
        count = head[end] + 1 if len(head) > end else 0
        end += 1
    elif code == 7:
        count = int.from_bytes(head[end : end + 2], "big") + 1
        end += 2
    else:
        count = _block_size(code)
    end += {12: 1, 13: 2, 14: 2}.get(head[2] & 0x0F, 0)
    if not count or end >= len(head) or _crc(head[:end], bits=8) != head[end]:
        return None
    variable = bool(head[1] & 1)
    before = number if variable else number * largest
    return (before, count) if before + count <= FLAC_MOST else None


def _block_size(code: int) -> int:
    """Samples of a frame by the four bits of its header (RFC 9639, table 14).

    >>> _block_size(1), _block_size(3), _block_size(12)
    (192, 1152, 4096)
    """
    if code == 1:
        return 192
    if 2 <= code <= 5:
        return 576 << (code - 2)
    return 256 << (code - 8) if code >= 8 else 0


def _coded_number(content: bytes) -> tuple[int, int]:
    """Decode a number as UTF-8 extended to 36 bits; returns it and the bytes that it
    takes, or 0 bytes if they are not such a number.

    >>> _coded_number(b"A"), _coded_number(bytes([0xC2, 0x80]))
    ((65, 1), (128, 2))
    >>> _coded_number(bytes([0x80]))
    (0, 0)
    """
    if not content:
        return 0, 0
    ones = 8 - (content[0] ^ 0xFF).bit_length()
    if ones == 0:
        return content[0], 1
    if ones == 1 or ones > 7 or len(content) < ones:
        return 0, 0
    number = content[0] & (0x7F >> ones)
    for byte in content[1:ones]:
        if byte >> 6 != 0b10:
            return 0, 0
        number = number << 6 | (byte & 0x3F)
    return number, ones


def _crc_table(polynomial: int, bits: int) -> tuple[int, ...]:
    table = []
    for byte in range(256):
        rest = byte << (bits - 8)
        for _ in range(8):
            rest = rest << 1 ^ (polynomial if rest >> (bits - 1) else 0)
            rest &= (1 << bits) - 1
        table.append(rest)
    return tuple(table)


_CRC_TABLES = {8: _crc_table(0x07, 8), 16: _crc_table(0x8005, 16)}
"""Tables of the two checksums, by their bits: 8 for a frame's header, x^8 + x^2 + x +
1, and 16 for a whole frame, x^16 + x^15 + x^2 + 1 (RFC 9639, sections 9.1.8 and
9.3)."""


def _crc(content: bytes, *, bits: int) -> int:
    table = _CRC_TABLES[bits]
    rest = 0
    mask = (1 << bits) - 1
    for byte in content:
        rest = (rest << 8 & mask) ^ table[rest >> (bits - 8) ^ byte]
    return rest
