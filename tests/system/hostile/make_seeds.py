#!/usr/bin/env python3
"""Writes small good files of the formats that are read, to be mutated: make_seeds.py FOLDER."""

import gzip
import pathlib
import struct
import sys

NX, NY, NZ = 12, 10, 8
VALUES = [(x * 7 + y * 5 + z * 3) % 200 + 1 for z in range(NZ) for y in range(NY) for x in range(NX)]


def nrrd(encoding):
    data = struct.pack(f"<{len(VALUES)}H", *VALUES)
    header = (f"NRRD0004\ntype: uint16\ndimension: 3\nsizes: {NX} {NY} {NZ}\n"
              "spacings: 1 1 2.5\nendian: little\n"
              f"encoding: {encoding}\n\n").encode()
    return header + (gzip.compress(data, mtime=0) if encoding == "gzip" else data)


def mha():
    header = ("ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\n"
              f"DimSize = {NX} {NY} {NZ}\nElementSpacing = 1 1 2.5\nElementType = MET_UCHAR\n"
              "ElementDataFile = LOCAL\n").encode()
    return header + bytes(VALUES)


def npy():
    text = f"{{'descr': '<f4', 'fortran_order': False, 'shape': ({NZ}, {NY}, {NX}), }}"
    text += " " * (117 - len(text)) + "\n"
    return (b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text.encode() +
            struct.pack(f"<{len(VALUES)}f", *VALUES))


def nifti():
    header = bytearray(352)
    struct.pack_into("<i", header, 0, 348)
    struct.pack_into("<8h", header, 40, 3, NX, NY, NZ, 1, 1, 1, 1)
    struct.pack_into("<2h", header, 70, 4, 16)  # int16
    struct.pack_into("<8f", header, 76, 1, 1, 1, 2.5, 1, 1, 1, 1)
    struct.pack_into("<3f", header, 108, 352, 2.0, -1.0)  # offset, slope, intercept
    struct.pack_into("<2h", header, 252, 0, 1)
    struct.pack_into("<12f", header, 280, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 2.5, 0)
    header[344:348] = b"n+1\0"
    return bytes(header) + struct.pack(f"<{len(VALUES)}h", *VALUES)


def tiff():
    """One page a slice, 16 bits, not compressed."""
    pages = [struct.pack(f"<{NX * NY}H", *VALUES[z * NX * NY:(z + 1) * NX * NY])
             for z in range(NZ)]
    blob = bytearray(b"II*\0\0\0\0\0")
    link = 4  # where the place of the next directory is to be written
    for pixels in pages:
        data_at = len(blob)
        blob += pixels
        struct.pack_into("<I", blob, link, len(blob))
        entries = [(256, 4, NX), (257, 4, NY), (258, 3, 16), (259, 3, 1), (262, 3, 1),
                   (273, 4, data_at), (277, 3, 1), (278, 4, NY), (279, 4, len(pixels)),
                   (339, 3, 1)]
        blob += struct.pack("<H", len(entries))
        for tag, kind, value in entries:
            blob += struct.pack("<HHII", tag, kind, 1, value)
        link = len(blob)
        blob += b"\0\0\0\0"
    return bytes(blob)


def main():
    folder = pathlib.Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    seeds = {"plain.nrrd": nrrd("raw"), "deflated.nrrd": nrrd("gzip"), "volume.mha": mha(),
             "array.npy": npy(), "scan.nii": nifti(), "scan.nii.gz": gzip.compress(nifti(), mtime=0),
             "stack.tif": tiff(), f"plain.{NX}x{NY}x{NZ}-uint8.raw": bytes(VALUES)}
    for name, content in seeds.items():
        (folder / name).write_bytes(content)


if __name__ == "__main__":
    main()
