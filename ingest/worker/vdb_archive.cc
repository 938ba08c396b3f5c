#include "ingest/worker/vdb_archive.h"

#include <cstring>
#include <filesystem>
#include <stdexcept>
#include <string_view>

#include <fmt/format.h>

namespace fovea::ingest {
namespace {

constexpr std::string_view kHalfSuffix = "_HalfFloat";
constexpr int64_t kMagicBytes = 8;
constexpr int32_t kMaxGrids = 100'000;

}  // namespace

VdbArchive::VdbArchive(const std::string& path)
    : stream_metadata_(new openvdb::io::StreamMetadata), stream_(path, std::ios::binary) {
  if (!stream_) {
    throw VdbFormatError(fmt::format("cannot open: {}", std::strerror(errno)));
  }
  file_bytes_ = static_cast<int64_t>(std::filesystem::file_size(path));
  if (file_bytes_ == 0) {
    throw VdbFormatError("the file is empty");
  }
  int64_t magic = 0;
  stream_.read(reinterpret_cast<char*>(&magic), sizeof(magic));
  if (file_bytes_ < kMagicBytes || magic != openvdb::OPENVDB_MAGIC) {
    throw VdbFormatError("not a VDB file (headerless voxels need --raw FORMAT)");
  }
  stream_.seekg(0);
  stream_.exceptions(std::ios::failbit | std::ios::badbit);
  readHeader(stream_);
  openvdb::io::setStreamMetadataPtr(stream_, stream_metadata_, /*transfer=*/false);
  setFormatVersion(stream_);
  setLibraryVersion(stream_);
  setDataCompression(stream_);
  metadata_.readMeta(stream_);
  const int32_t count = readGridCount(stream_);
  if (count < 0 || count > kMaxGrids) {
    throw VdbFormatError(fmt::format("damaged: it claims to hold {} grids", count));
  }
  for (int32_t i = 0; i < count; ++i) {
    ReadDescriptor();
  }
}

std::string VdbArchive::ReadText() {
  uint32_t size = 0;
  stream_.read(reinterpret_cast<char*>(&size), sizeof(size));
  if (size > file_bytes_) {
    throw VdbFormatError("damaged: a name is longer than the file");
  }
  std::string text(size, '\0');
  stream_.read(text.data(), size);
  return text;
}

// Not GridDescriptor::read, which gives the whole file up at a grid of a type it does not know.
void VdbArchive::ReadDescriptor() {
  const std::string name = ReadText();
  std::string type = ReadText();
  const bool half = std::string_view(type).ends_with(kHalfSuffix);
  if (half) {
    type.resize(type.size() - kHalfSuffix.size());
  }
  openvdb::io::GridDescriptor descriptor(name, type, half);
  descriptor.setInstanceParentName(ReadText());
  int64_t positions[3] = {0, 0, 0};  // of the grid, its blocks, and the next descriptor
  stream_.read(reinterpret_cast<char*>(positions), sizeof(positions));
  descriptor.setGridPos(positions[0]);
  descriptor.setBlockPos(positions[1]);
  descriptor.setEndPos(positions[2]);
  if (!inputHasGridOffsets()) {  // written to a pipe: the next grid begins where this one ends
    descriptor.setGridPos(stream_.tellg());
    static_cast<void>(ReadTree(descriptor));
    descriptor.setEndPos(stream_.tellg());
  }
  if (descriptor.getGridPos() <= 0 || descriptor.getEndPos() < descriptor.getGridPos()) {
    throw VdbFormatError(fmt::format("damaged: the place of grid '{}' makes no sense",
                                     openvdb::io::GridDescriptor::nameAsString(name)));
  }
  if (descriptor.getEndPos() > file_bytes_) {
    throw VdbFormatError(fmt::format("cut short: grid '{}' ends at byte {}, the file has {}",
                                     openvdb::io::GridDescriptor::nameAsString(name),
                                     descriptor.getEndPos(), file_bytes_));
  }
  descriptor.seekToEnd(stream_);
  grids_.push_back(descriptor);
}

openvdb::GridBase::Ptr VdbArchive::ReadMetadata(const openvdb::io::GridDescriptor& descriptor) {
  openvdb::GridBase::Ptr grid = openvdb::GridBase::createGrid(descriptor.gridType());
  grid->setSaveFloatAsHalf(descriptor.saveFloatAsHalf());
  descriptor.seekToGrid(stream_);
  readGridCompression(stream_);
  grid->readMeta(stream_);
  grid->readTransform(stream_);
  return grid;
}

openvdb::GridBase::Ptr VdbArchive::ReadTree(const openvdb::io::GridDescriptor& descriptor) {
  openvdb::GridBase::Ptr grid = openvdb::GridBase::createGrid(descriptor.gridType());
  grid->setSaveFloatAsHalf(descriptor.saveFloatAsHalf());
  descriptor.seekToGrid(stream_);
  openvdb::io::Archive::readGrid(grid, descriptor, stream_);
  return grid;
}

openvdb::GridBase::Ptr VdbArchive::ReadGrid(const openvdb::io::GridDescriptor& descriptor) {
  openvdb::GridBase::Ptr grid = ReadTree(descriptor);
  if (!descriptor.isInstance()) {
    return grid;
  }
  for (const openvdb::io::GridDescriptor& other : grids_) {
    if (other.uniqueName() == descriptor.instanceParentName() && !other.isInstance()) {
      if (other.gridType() != descriptor.gridType()) {
        throw VdbFormatError("damaged: a grid shares the tree of a grid of another type");
      }
      grid->setTree(ReadTree(other)->baseTreePtr());
      return grid;
    }
  }
  throw VdbFormatError("damaged: the grid whose tree is shared is not there");
}

}  // namespace fovea::ingest
