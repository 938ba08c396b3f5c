#include "ingest/worker/vdb_reader.h"

#include <cmath>
#include <exception>
#include <functional>
#include <new>
#include <stdexcept>
#include <string>

#include "ingest/worker/limits.h"
#include "ingest/worker/vdb_archive.h"
#include "ingest/worker/vdb_sender.h"

namespace fovea::ingest {
namespace {

/// The one place where OpenVDB's exceptions end.
Status Guarded(const std::function<Status()>& body) {
  try {
    return body();
  } catch (const std::bad_alloc&) {
    return OutOfMemory();
  } catch (const VdbFormatError& error) {
    return DataLoss("{}", error.what());
  } catch (const std::ios_base::failure&) {
    return DataLoss("cut short or damaged: the file ends in the middle of something");
  } catch (const openvdb::Exception& error) {
    return DataLoss("OpenVDB cannot read it: {}", error.what());
  } catch (const std::length_error&) {
    return DataLoss("damaged: a size in it makes no sense");
  } catch (const std::exception& error) {
    return DataLoss("cannot be read: {}", error.what());
  }
}

std::string FindWorldUnit(const openvdb::MetaMap& metadata) {
  for (const char* key : {"world_unit", "world_units", "unit", "units"}) {
    if (const auto text = metadata.getMetadata<openvdb::StringMetadata>(key)) {
      return text->value();
    }
  }
  return {};
}

/// Ours maps voxel centres as OpenVDB does; where a voxel begins is the program's business.
/// OpenVDB multiplies row vectors, so its matrix is transposed.
Matrix4 IndexToWorld(const openvdb::math::Transform& transform) {
  const openvdb::math::Mat4d matrix = transform.baseMap()->getAffineMap()->getMat4();
  Matrix4 result;
  for (int row = 0; row < 4; ++row) {
    for (int column = 0; column < 4; ++column) {
      result.m[static_cast<size_t>(4 * row + column)] = matrix(column, row);
    }
  }
  return result;
}

bool IsUsable(const Matrix4& matrix) {
  for (const double element : matrix.m) {
    if (!std::isfinite(element)) {
      return false;
    }
  }
  const double determinant = matrix.Determinant();
  return std::isfinite(determinant) && determinant != 0;
}

/// The box of the active voxels by the metadata, if they say something credible.
std::optional<Box3> DeclaredBox(const openvdb::GridBase& grid) {
  using openvdb::GridBase;
  const auto low = grid.getMetadata<openvdb::Vec3IMetadata>(GridBase::META_FILE_BBOX_MIN);
  const auto high = grid.getMetadata<openvdb::Vec3IMetadata>(GridBase::META_FILE_BBOX_MAX);
  const auto count = grid.getMetadata<openvdb::Int64Metadata>(GridBase::META_FILE_VOXEL_COUNT);
  if (!low || !high || !count) {
    return std::nullopt;
  }
  if (count->value() == 0) {
    return Box3{};
  }
  const openvdb::CoordBBox box(openvdb::Coord(low->value()), openvdb::Coord(high->value()));
  return box.empty() ? std::nullopt : std::optional<Box3>(ToBox(box));
}

void DescribeVoxels(const openvdb::GridBase& grid, GridInfo* about) {
  const openvdb::CoordBBox active = grid.evalActiveVoxelBoundingBox();
  about->box = active.empty() ? Box3{} : ToBox(active);
  about->declared_bytes = static_cast<int64_t>(grid.memUsage());
}

GridInfo DescribeGrid(VdbArchive* archive, const openvdb::io::GridDescriptor& descriptor,
                      bool from_voxels, std::string* unit) {
  GridInfo about;
  about.name = openvdb::io::GridDescriptor::nameAsString(descriptor.uniqueName());
  about.type = descriptor.gridType();
  if (!openvdb::GridBase::isRegistered(descriptor.gridType())) {
    about.problem = fmt::format("type {} is not known", descriptor.gridType());
    return about;
  }
  const openvdb::GridBase::Ptr grid = archive->ReadMetadata(descriptor);
  about.type = grid->valueType();
  if (!IsScalar(*grid)) {
    about.problem = fmt::format("type {} is not a scalar", about.type);
    return about;
  }
  if (!grid->transform().isLinear()) {
    about.problem = fmt::format("its transform ({}) is not linear", grid->transform().mapType());
    return about;
  }
  const Matrix4 matrix = IndexToWorld(grid->transform());
  if (!IsUsable(matrix)) {
    about.problem = "its transform cannot be inverted";
    return about;
  }
  about.index_to_world = matrix;
  if (unit->empty()) {
    *unit = FindWorldUnit(*grid);
  }
  const auto bytes =
      grid->getMetadata<openvdb::Int64Metadata>(openvdb::GridBase::META_FILE_MEM_BYTES);
  about.declared_bytes = bytes ? std::max<int64_t>(0, bytes->value()) : 0;
  const std::optional<Box3> declared = from_voxels ? std::nullopt : DeclaredBox(*grid);
  if (declared) {
    about.box = *declared;
  } else {
    DescribeVoxels(*archive->ReadGrid(descriptor), &about);
  }
  return about;
}

Status SendScan(const ScanRequest& request, Channel* channel) {
  VdbArchive archive(request.paths.front());
  FileInfo file;
  file.file_bytes = archive.file_bytes();
  file.world_unit = FindWorldUnit(archive.metadata());
  std::vector<GridInfo> grids;
  for (const openvdb::io::GridDescriptor& descriptor : archive.grids()) {
    grids.push_back(DescribeGrid(&archive, descriptor, request.from_voxels, &file.world_unit));
  }
  FOVEA_RETURN_IF_ERROR(channel->Send(Encode(file), Channel::kNoDeadline));
  for (const GridInfo& grid : grids) {
    FOVEA_RETURN_IF_ERROR(channel->Send(Encode(grid), Channel::kNoDeadline));
  }
  return absl::OkStatus();
}

Status SendGrids(const ReadRequest& request, Channel* channel) {
  VdbArchive archive(request.paths.front());
  for (size_t i = 0; i < request.grids.size(); ++i) {
    const openvdb::io::GridDescriptor* wanted = nullptr;
    for (const openvdb::io::GridDescriptor& descriptor : archive.grids()) {
      const std::string name = openvdb::io::GridDescriptor::nameAsString(descriptor.uniqueName());
      if (wanted == nullptr && name == request.grids[i]) {
        wanted = &descriptor;
      }
    }
    if (wanted == nullptr || !openvdb::GridBase::isRegistered(wanted->gridType())) {
      return NotFound("grid '{}' is not there any more", request.grids[i]);
    }
    const openvdb::GridBase::Ptr grid = archive.ReadGrid(*wanted);
    FOVEA_RETURN_IF_ERROR(SendGrid(*grid, static_cast<uint32_t>(i), request.extent, channel));
  }
  return absl::OkStatus();
}

}  // namespace

Status ScanVdb(const ScanRequest& request, Channel* channel) {
  return Guarded([&] {
    openvdb::initialize();
    return SendScan(request, channel);
  });
}

Status ReadVdb(const ReadRequest& request, Channel* channel) {
  return Guarded([&] {
    openvdb::initialize();
    return SendGrids(request, channel);
  });
}

std::string OpenVdbVersion() {
  return openvdb::getLibraryVersionString();
}

}  // namespace fovea::ingest
