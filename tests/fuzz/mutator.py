# SPDX-License-Identifier: Apache-2.0
"""Inputs that are nearly right: changes of good ones, each told by a seed and a number alone."""

from __future__ import annotations

import random
import struct

NUMBERS = (
    b"0", b"-0", b"1", b"-1", b"3", b"7", b"1e308", b"-1e308", b"1e309", b"1e-320", b"nan", b"inf",
    b"-inf", b"1_0", b"0x10", b"0145", b"1:30", b"1,5", b"1.", b".5", b"+2", b"--2", b"1e", b"1e5",
    b"9223372036854775808", b"18446744073709551616", b"99999999999999999999999999", b"", b"true",
    b"null", b"\xd9\xa1\xd9\xa2", b"\xef\xbc\x91", b"2147483648", b"-2147483649", b"4294967296",
    b"0.1", b"1e-9", b"1e9", b"65536", b"NaN", b"1d3", b"1 2", b"'3'", b'"3"',
)  # fmt: skip
SCRAPS = (
    b"\x00", b"\xff", b"\xfe\xff", b"\xef\xbb\xbf", b"\r", b"\r\n", b"\n", b"\n\n", b"\t", b" ",
    b"\xc2\x85", b"\xe2\x80\xa8", b"\x0b", b"\x0c", b"\x1c", b'"', b"'", b",", b";", b":", b": ",
    b"- ", b"#", b"&a ", b"*a", b"<<: ", b"{", b"}", b"[", b"]", b"<", b">", b"&amp;", b"&x;",
    b"<!ENTITY a 'b'>", b"<!--", b"-->", b"|", b"?", b"!!python/object:os.system", b"%00", b"\\",
    b"\xf0\x9f\x98\x80", b"\xed\xa0\x80", b"../", b"=", b"%", b"@", b"`", b"---\n", b"...\n", b"~",
)  # fmt: skip
WORDS32 = (0, 1, 2, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 0x10000, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF)
DOUBLES = (0.0, -0.0, 1e308, -1e308, 5e-324, float("nan"), float("inf"), float("-inf"), 1e30, 1e-30)
LARGEST = 65536
"""Longest input [bytes]; longer ones are cut."""


class Mutator:
    """Makes input number k of a target.

    The same seed, target and number give the same input, so that a run goes on where it was and a
    finding is repeated by its number.
    """

    def __init__(self, name: str, seed: int, corpus: list[bytes], text: bool) -> None:
        """Prepare.

        Args:
            name: of the target.
            seed: of the run.
            corpus: good inputs.
            text: whether they are text; else numbers are also changed as binary words.
        """
        self._name, self._seed, self._corpus, self._text = name, seed, corpus, text

    def make(self, number: int) -> bytes:
        """Input of a number: the good ones first, then changes of them."""
        if number < len(self._corpus):
            return self._corpus[number]
        rng = random.Random(f"{self._seed}/{self._name}/{number}")
        data = bytearray(rng.choice(self._corpus))
        for _ in range(1 + int(rng.expovariate(0.8))):
            self._change(rng, data)
            del data[LARGEST:]
        return bytes(data)

    def _change(self, rng: random.Random, data: bytearray) -> None:
        kinds = _TEXT if self._text else _BINARY
        rng.choice(kinds)(rng, data, self._corpus)


def _place(rng: random.Random, data: bytearray) -> int:
    return rng.randrange(len(data) + 1)


def _flip(rng: random.Random, data: bytearray, _: list[bytes]) -> None:
    if data:
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)


def _byte(rng: random.Random, data: bytearray, _: list[bytes]) -> None:
    if data:
        data[rng.randrange(len(data))] = rng.randrange(256)


def _insert(rng: random.Random, data: bytearray, _: list[bytes]) -> None:
    at = _place(rng, data)
    data[at:at] = rng.choice(SCRAPS)


def _delete(rng: random.Random, data: bytearray, _: list[bytes]) -> None:
    at = _place(rng, data)
    del data[at : at + rng.choice((1, 1, 2, 4, 8, 40))]


def _cut(rng: random.Random, data: bytearray, _: list[bytes]) -> None:
    del data[_place(rng, data) :]


def _double(rng: random.Random, data: bytearray, _: list[bytes]) -> None:
    at = _place(rng, data)
    piece = data[at : at + rng.choice((1, 4, 16, 80))]
    data[at:at] = piece * rng.choice((1, 1, 1, 2, 30))


def _splice(rng: random.Random, data: bytearray, corpus: list[bytes]) -> None:
    other = rng.choice(corpus)
    begin = rng.randrange(len(other) + 1)
    at = _place(rng, data)
    size = rng.choice((4, 16, 64, 400))
    data[at : at + rng.choice((0, size))] = other[begin : begin + size]


def _lines(rng: random.Random, data: bytearray, _: list[bytes]) -> None:
    """Drop, repeat or move a line."""
    lines = bytes(data).split(b"\n")
    line = lines.pop(rng.randrange(len(lines)))
    for _ in range(rng.choice((0, 1, 2))):
        lines.insert(rng.randrange(len(lines) + 1), line)
    data[:] = b"\n".join(lines)


def _number(rng: random.Random, data: bytearray, _: list[bytes]) -> None:
    """Another number in the place of one."""
    digits = [i for i, c in enumerate(data) if 48 <= c <= 57]
    if not digits:
        return
    begin = end = rng.choice(digits)
    part = b"0123456789.+-eE"
    while begin > 0 and data[begin - 1] in part:
        begin -= 1
    while end < len(data) and data[end] in part:
        end += 1
    data[begin:end] = rng.choice(NUMBERS)


def _digit(rng: random.Random, data: bytearray, _: list[bytes]) -> None:
    digits = [i for i, c in enumerate(data) if 48 <= c <= 57]
    if digits:
        data[rng.choice(digits)] = 48 + rng.randrange(10)


def _word(rng: random.Random, data: bytearray, _: list[bytes]) -> None:
    if len(data) >= 4:
        at = rng.randrange(len(data) - 3)
        at -= at % rng.choice((1, 4))
        data[at : at + 4] = struct.pack("<I", rng.choice(WORDS32))


def _small(rng: random.Random, data: bytearray, _: list[bytes]) -> None:
    """A length or enumeration that is off by a little."""
    if len(data) >= 4:
        at = rng.randrange(len(data) - 3) & ~3
        value = struct.unpack_from("<I", data, at)[0]
        data[at : at + 4] = struct.pack("<I", (value + rng.choice((-2, -1, 1, 2, 8))) & 0xFFFFFFFF)


def _real(rng: random.Random, data: bytearray, _: list[bytes]) -> None:
    if len(data) >= 12:
        at = 4 + 8 * rng.randrange((len(data) - 4) // 8)
        data[at : at + 8] = struct.pack("<d", rng.choice(DOUBLES))


def _noise(rng: random.Random, data: bytearray, _: list[bytes]) -> None:
    at = _place(rng, data)
    size = min(rng.choice((4, 16, 100)), len(data) - at)
    data[at : at + size] = rng.randbytes(size)


_TEXT = (
    _flip, _byte, _insert, _insert, _delete, _cut, _double, _splice, _lines, _lines, _number,
    _number, _number, _digit, _digit,
)  # fmt: skip
_BINARY = (
    _flip, _flip, _byte, _delete, _cut, _double, _splice, _word, _word, _small, _small, _real,
    _noise, _insert,
)  # fmt: skip
