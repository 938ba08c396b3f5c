// Cuts the sample sequence in tests/data/plume out of a longer Blender smoke bake: density and
// temperature of every fourth frame, values rounded to half floats, zip-compressed. How the sample
// was made is on record here; nothing in the build runs it by itself.
//   make_plume BAKE_DIR OUTPUT_DIR      BAKE_DIR holds fluid_data_0001.vdb to fluid_data_0060.vdb

#include <cstdio>
#include <exception>
#include <string>

#include <fmt/format.h>
#include <openvdb/io/Compression.h>
#include <openvdb/openvdb.h>

namespace {

constexpr int kFirstFrame = 1;
constexpr int kLastFrame = 57;
constexpr int kStride = 4;

openvdb::GridBase::Ptr ReadGrid(openvdb::io::File& file, const std::string& name) {
  openvdb::GridBase::Ptr grid = file.readGrid(name);
  grid->setSaveFloatAsHalf(true);
  return grid;
}

void CutFrame(const std::string& from, const std::string& to) {
  openvdb::io::File source(from);
  source.open();
  openvdb::GridPtrVec grids{ReadGrid(source, "density"), ReadGrid(source, "temperature")};
  openvdb::io::File target(to);
  target.setCompression(openvdb::io::COMPRESS_ZIP | openvdb::io::COMPRESS_ACTIVE_MASK);
  target.write(grids);
  target.close();
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) {
    std::fprintf(stderr, "usage: make_plume BAKE_DIR OUTPUT_DIR\n");
    return 2;
  }
  try {
    openvdb::initialize();
    for (int frame = kFirstFrame; frame <= kLastFrame; frame += kStride) {
      CutFrame(fmt::format("{}/fluid_data_{:04d}.vdb", argv[1], frame),
               fmt::format("{}/plume_{:04d}.vdb", argv[2], frame));
    }
  } catch (const std::exception& error) {
    std::fprintf(stderr, "make_plume: %s\n", error.what());
    return 1;
  }
  return 0;
}
