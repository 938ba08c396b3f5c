#include "ingest/sparse_fields.h"

#include <memory>

#include "engine/base/parallel.h"
#include "ingest/field_stream.h"

namespace fovea::ingest {
namespace {

Status WriteField(const std::string& field, BrickGrid bricks, const Basis& basis, int threads,
                  store::DatasetWriter* writer) {
  const auto voxels = std::make_shared<const BrickGrid>(std::move(bricks));
  FOVEA_ASSIGN_OR_RETURN(const auto stream,
                         FieldStream::Start(writer, field, basis, voxels->background(), threads));
  FOVEA_RETURN_IF_ERROR(stream->Push(voxels));
  return stream->Finish(ComputeStats(*voxels));
}

}  // namespace

void SparseFields::Add(std::string field, BrickGrid voxels) {
  bytes_ += std::ssize(voxels.bricks()) * voxels.brick_values() * int64_t{sizeof(float)};
  fields_.emplace_back(std::move(field), std::move(voxels));
}

Status SparseFields::Write(store::DatasetWriter* writer) {
  auto fields = std::exchange(fields_, {});
  bytes_ = 0;
  const int threads = fields.size() > 1 ? 1 : threads_;
  std::vector<Status> results(fields.size());
  ParallelFor(0, std::ssize(fields), 1, threads_, [&](int64_t first, int64_t last) {
    for (auto i = static_cast<size_t>(first); i < static_cast<size_t>(last); ++i) {
      results[i] =
          WriteField(fields[i].first, std::move(fields[i].second), basis_, threads, writer);
    }
  });
  for (const Status& result : results) {
    FOVEA_RETURN_IF_ERROR(result);
  }
  return absl::OkStatus();
}

}  // namespace fovea::ingest
