"""What the compiled OBJ parser keeps from block to block: slots of one small array of integers."""

from __future__ import annotations

# Slots of the state array.
(
    VERTICES,
    UVS,
    TRIANGLES,
    COLOURED,
    FIRST_COLOURED,
    BARE,
    LINE,
    ERROR,
    ERROR_LINE,
    ERROR_AT,
    LAST_ITEM,
    FACE_LINE,
    NAMES,
    FORWARD,
    FORWARD_LINE,
    FORWARD_UV,
    FORWARD_UV_LINE,
    STATE_SIZE,
) = range(18)

# Values of state[ERROR].
(
    OK,
    BAD_NUMBER,
    FEW_COORDINATES,
    BAD_CORNER,
    OUT_OF_RANGE,
    FEW_CORNERS,
    MIXED_CORNERS,
    BINARY,
    FULL,
) = range(9)

#: Line ends after every block.
PADDING = 64
