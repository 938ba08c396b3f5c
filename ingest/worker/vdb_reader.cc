#include "ingest/worker/vdb_reader.h"

#include <cmath>
#include <exception>
#include <functional>
#include <new>
#include <stdexcept>
#include <string>

#include "ingest/worker/limits.h"
#include "ingest/worker/vdb_archive.h"
#include "ingest/worker/vdb_lattice.h"
#include "ingest/worker/vdb_sender.h"
#include "ingest/worker/vdb_vector.h"

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

std::string NameOf(const openvdb::io::GridDescriptor& descriptor) {
  return openvdb::io::GridDescriptor::nameAsString(descriptor.uniqueName());
}

/// Why a grid of this type, which is neither of scalars nor of vectors, cannot be read.
std::string WhyUnreadable(const std::string& type, const char* otherwise) {
  const bool points =
      type.find("ptdataidx") != std::string::npos || type.find("ptidx") != std::string::npos;
  return points
             ? "it holds points (particles), not voxels; make a density or level set of them first"
             : fmt::format("type {} is not {}", type, otherwise);
}

GridInfo DescribeGrid(VdbArchive* archive, const openvdb::io::GridDescriptor& descriptor,
                      bool from_voxels, std::string* unit) {
  GridInfo about;
  about.name = NameOf(descriptor);
  about.type = descriptor.gridType();
  if (!openvdb::GridBase::isRegistered(descriptor.gridType())) {
    about.problem = WhyUnreadable(descriptor.gridType(), "known");
    return about;
  }
  const openvdb::GridBase::Ptr grid = archive->ReadMetadata(descriptor);
  about.type = grid->valueType();
  if (!IsScalar(*grid) && !IsVector(*grid)) {
    about.problem = WhyUnreadable(about.type, "a scalar");
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

/// What a grid offers: itself, or if it holds vectors their length and components, on request.
void Offer(GridInfo grid, std::vector<GridInfo>* offered) {
  if (!grid.problem.empty() || !grid.type.starts_with("vec3")) {
    offered->push_back(std::move(grid));
    return;
  }
  GridInfo vectors = grid;
  vectors.problem = fmt::format(
      "type {} is a vector; ask for its length with --grid "
      "{}.magnitude, or for a component with --grid {}.x",
      grid.type, grid.name, grid.name);
  offered->push_back(std::move(vectors));
  for (const std::string_view part : kVectorPartNames) {
    GridInfo scalar = grid;
    scalar.name = fmt::format("{}.{}", grid.name, part);
    scalar.on_request = true;
    offered->push_back(std::move(scalar));
  }
}

Status SendScan(const ScanRequest& request, Channel* channel) {
  VdbArchive archive(request.paths.front());
  FileInfo file;
  file.file_bytes = archive.file_bytes();
  file.world_unit = FindWorldUnit(archive.metadata());
  std::vector<GridInfo> grids;
  for (const openvdb::io::GridDescriptor& descriptor : archive.grids()) {
    Offer(DescribeGrid(&archive, descriptor, request.from_voxels, &file.world_unit), &grids);
  }
  FOVEA_RETURN_IF_ERROR(channel->Send(Encode(file), Channel::kNoDeadline));
  for (const GridInfo& grid : grids) {
    FOVEA_RETURN_IF_ERROR(channel->Send(Encode(grid), Channel::kNoDeadline));
  }
  return absl::OkStatus();
}

const openvdb::io::GridDescriptor* FindReadable(const VdbArchive& archive,
                                                const std::string& name) {
  for (const openvdb::io::GridDescriptor& descriptor : archive.grids()) {
    if (NameOf(descriptor) == name && openvdb::GridBase::isRegistered(descriptor.gridType())) {
      return &descriptor;
    }
  }
  return nullptr;
}

/// The grid of this name as scalars: itself, or what it is of a grid of vectors.
StatusOr<openvdb::GridBase::Ptr> ReadScalars(VdbArchive* archive, const std::string& name) {
  if (const auto* descriptor = FindReadable(*archive, name)) {
    return archive->ReadGrid(*descriptor);
  }
  const std::optional<VectorName> vector = ParseVectorName(name);
  const auto* descriptor = vector ? FindReadable(*archive, vector->grid) : nullptr;
  if (descriptor == nullptr) {
    return NotFound("grid '{}' is not there any more", name);
  }
  const openvdb::GridBase::Ptr grid = archive->ReadGrid(*descriptor);
  if (!IsVector(*grid)) {
    return InvalidArgument("grid '{}' does not hold vectors", vector->grid);
  }
  return openvdb::GridBase::Ptr(ScalarOf(*grid, vector->part));
}

Status SendGrids(const ReadRequest& request, Channel* channel) {
  VdbArchive archive(request.paths.front());
  for (size_t i = 0; i < request.grids.size(); ++i) {
    FOVEA_ASSIGN_OR_RETURN(openvdb::GridBase::Ptr grid, ReadScalars(&archive, request.grids[i]));
    if (request.lattice) {
      FOVEA_ASSIGN_OR_RETURN(grid, OnLattice(grid, *request.lattice));
    }
    FOVEA_RETURN_IF_ERROR(SendGrid(*grid, static_cast<uint32_t>(i), request.extent, channel));
    FreeVoxels(grid.get());
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
