"""The blocks of an MDF4 file, looked at before any library follows their links.

Format: ASAM MDF 4.2. After 64 bytes of identification come blocks: "##" and two letters, four bytes, the length (8 bytes), the
number of links (8 bytes), the links (8 bytes each, 0 for none), data. Every link leads to the first byte of a block.
"""

import struct
from pathlib import Path

_HEAD = 24  # bytes of a block before its links
_FIRST = 64  # byte at which the header block stands
_MOST_BLOCKS = 2_000_000  # those of a file with 20 thousand channels are some 200 thousand
_UNFINISHED = b"UnFinMF"
_DATA = (b"##DT", b"##SD", b"##RD", b"##DV", b"##DI", b"##RV", b"##RI")  # whose length an unfinished file may not know
_DEFLATED = b"##DZ"
_DEFLATE_RATIO = 1032  # [-] the most that deflate can save (zlib's own documentation)


def check_blocks(file: Path) -> None:
    """Raise `ValueError` for links or lengths that lead out of the file, and for data that cannot be as long as it says."""
    size = file.stat().st_size
    with file.open("rb") as stream:
        head = stream.read(_FIRST)
        if not head.startswith((b"MDF     ", _UNFINISHED)) or head[8:9] != b"4":
            raise ValueError("it does not begin as one")
        unfinished = head.startswith(_UNFINISHED)
        waiting, seen = [_FIRST], {_FIRST}
        while waiting:
            at = waiting.pop()
            stream.seek(at)
            block = stream.read(_HEAD)
            if len(block) < _HEAD or not block.startswith(b"##"):
                raise ValueError(f"a link leads to byte {at}, where no block begins")
            length, links = struct.unpack_from("<QQ", block, 8)
            name = block[:4]
            open_end = unfinished and name in _DATA
            if at + length > size and not open_end:
                raise ValueError(f"the block at byte {at} ends beyond the file")
            if _HEAD + 8 * links > length and not open_end:
                raise ValueError(f"the block at byte {at} has {links} links in {length} bytes")
            if name == _DEFLATED:
                _, _, _, _, unpacked, packed = struct.unpack("<2sBBIQQ", stream.read(24))
                if packed > length or unpacked > _DEFLATE_RATIO * max(packed, 1):
                    raise ValueError(f"the block at byte {at} cannot unpack to {unpacked} bytes")
            for link in () if open_end else struct.unpack(f"<{links}Q", stream.read(8 * links)) if name != _DEFLATED else ():
                if link and link not in seen:
                    if not _FIRST <= link <= size - _HEAD:
                        raise ValueError(f"the block at byte {at} has a link out of the file")
                    seen.add(link)
                    waiting.append(link)
            if len(seen) > _MOST_BLOCKS:
                raise ValueError(f"it has more than {_MOST_BLOCKS} blocks")
