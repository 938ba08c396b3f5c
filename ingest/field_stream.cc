#include "ingest/field_stream.h"

#include <utility>

namespace fovea::ingest {
namespace {

wavelet::CoefficientType TypeOf(const std::string& stored) {
  return stored == "int16"   ? wavelet::CoefficientType::kInt16
         : stored == "int32" ? wavelet::CoefficientType::kInt32
                             : wavelet::CoefficientType::kFloat32;
}

}  // namespace

StatusOr<std::unique_ptr<FieldStream>> FieldStream::Start(store::DatasetWriter* writer,
                                                          const std::string& field,
                                                          const Basis& basis, float background,
                                                          int threads) {
  FOVEA_ASSIGN_OR_RETURN(auto field_writer, writer->BeginField(field));
  wavelet::ForwardStreamOptions options;
  options.hierarchy = writer->info().hierarchy;
  options.basis = basis;
  options.type = TypeOf(writer->info().TypeOf(field));
  options.edge = writer->info().chunk_edge;
  options.background = background;
  options.threads = threads;
  std::unique_ptr<FieldStream> stream(new FieldStream(std::move(field_writer)));
  FOVEA_ASSIGN_OR_RETURN(stream->transform_, wavelet::ForwardStream::Make(options, stream.get()));
  return stream;
}

Status FieldStream::Push(DenseSlices slices) {
  return transform_->Push(slices.values, std::move(slices.owner));
}

Status FieldStream::Push(std::shared_ptr<const BrickGrid> voxels) {
  const int64_t layers = (voxels->dims().z + voxels->edge() - 1) / voxels->edge();
  return transform_->Push(std::move(voxels), layers);
}

Status FieldStream::Finish(const FieldStats& stats) {
  FOVEA_ASSIGN_OR_RETURN(const Grid coarse, transform_->Finish());
  return writer_->Finish(coarse, stats);
}

}  // namespace fovea::ingest
