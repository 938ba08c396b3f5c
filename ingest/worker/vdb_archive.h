#ifndef INGEST_WORKER_VDB_ARCHIVE_H_
#define INGEST_WORKER_VDB_ARCHIVE_H_

#include <cstdint>
#include <fstream>
#include <string>
#include <vector>

#include <openvdb/io/Archive.h>
#include <openvdb/io/GridDescriptor.h>
#include <openvdb/io/io.h>
#include <openvdb/openvdb.h>

/// Included by the VDB reader's two source files only: the header is heavy.
namespace fovea::ingest {

/// A file that is not what it should be: too short, or not a VDB at all.
class VdbFormatError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// An OpenVDB file read through OpenVDB's own parser, but with a stream that throws at the end of
/// the file: openvdb::io::File takes what it cannot read for zeros. All members throw.
class VdbArchive : private openvdb::io::Archive {
 public:
  /// Reads the header, the metadata and the list of grids.
  explicit VdbArchive(const std::string& path);

  /// The grids in the order of the file.
  [[nodiscard]] const std::vector<openvdb::io::GridDescriptor>& grids() const { return grids_; }
  [[nodiscard]] const openvdb::MetaMap& metadata() const { return metadata_; }
  [[nodiscard]] int64_t file_bytes() const { return file_bytes_; }

  /// Metadata and transform, with an empty tree. The type must be registered.
  [[nodiscard]] openvdb::GridBase::Ptr ReadMetadata(const openvdb::io::GridDescriptor& descriptor);
  /// Everything, also of a grid that shares the tree of another.
  [[nodiscard]] openvdb::GridBase::Ptr ReadGrid(const openvdb::io::GridDescriptor& descriptor);

 private:
  void ReadDescriptor();
  [[nodiscard]] std::string ReadText();
  [[nodiscard]] openvdb::GridBase::Ptr ReadTree(const openvdb::io::GridDescriptor& descriptor);

  int64_t file_bytes_ = 0;
  openvdb::io::StreamMetadata::Ptr stream_metadata_;
  std::ifstream stream_;
  openvdb::MetaMap metadata_;
  std::vector<openvdb::io::GridDescriptor> grids_;
};

}  // namespace fovea::ingest

#endif  // INGEST_WORKER_VDB_ARCHIVE_H_
