#include "ingest/quantised_step.h"

#include <utility>
#include <variant>

#include "engine/wavelet/transform.h"
#include "ingest/quantise.h"

namespace fovea::ingest {

QuantisedStep::QuantisedStep(std::vector<std::string> fields, const Hierarchy& hierarchy,
                             const Basis& basis, int64_t edge, int threads)
    : fields_(std::move(fields)),
      hierarchy_(hierarchy),
      basis_(basis),
      threads_(threads),
      voxels_(fields_.size(), BrickGrid(hierarchy.dims(), edge, 1, 0.0F)),
      next_slice_(fields_.size(), 0) {}

void QuantisedStep::Add(const DensePiece& piece) {
  const Int3& dims = hierarchy_.dims();
  int64_t& first = next_slice_[piece.field];
  const Box3 box{{0, 0, first}, {dims.x, dims.y, first + piece.slices.count}};
  const std::vector<float> values =
      std::visit([](const auto& typed) { return std::vector<float>(typed.begin(), typed.end()); },
                 piece.slices.values);
  voxels_[piece.field].CopyIn(box, values);
  first += piece.slices.count;
}

StatusOr<std::vector<store::FieldInfo>> QuantisedStep::ChooseCodings(
    const Tolerance& tolerance) const {
  std::vector<store::FieldInfo> codings(fields_.size());
  for (size_t i = 0; i < fields_.size(); ++i) {
    codings[i].name = fields_[i];
    FOVEA_RETURN_IF_ERROR(ChooseScales(wavelet::Forward(voxels_[i], hierarchy_, basis_, threads_),
                                       ComputeStats(voxels_[i]), tolerance, &codings[i]));
  }
  return codings;
}

Status QuantisedStep::WriteField(const store::FieldInfo& field, const BrickGrid& voxels,
                                 store::DatasetWriter* writer) const {
  CoefficientSet set = wavelet::Forward(voxels, hierarchy_, basis_, threads_);
  if (!field.scales.empty()) {
    FOVEA_RETURN_IF_ERROR(Quantise(field, &set, threads_));
    FOVEA_ASSIGN_OR_RETURN(const double error, LargestError(voxels, set, threads_));
    if (!(error <= field.tolerance)) {
      return Internal("field '{}' would be off by {}, more than its tolerance of {}: please report",
                      field.name, error, field.tolerance);
    }
    writer->NoteMaxError(field.name, error);
  }
  return writer->WriteField(field.name, set, ComputeStats(voxels));
}

Status QuantisedStep::Write(store::DatasetWriter* writer) {
  for (size_t i = 0; i < fields_.size(); ++i) {
    FOVEA_RETURN_IF_ERROR(WriteField(writer->info().FieldOf(fields_[i]), voxels_[i], writer));
    voxels_[i] = BrickGrid();
  }
  return absl::OkStatus();
}

void WarnOfExact(const std::vector<store::FieldInfo>& codings, std::vector<std::string>* warnings) {
  for (const store::FieldInfo& coding : codings) {
    if (coding.scales.empty()) {
      warnings->push_back(
          fmt::format("field '{}': nothing in its first step to choose scales by: stored as "
                      "float32, which is exact",
                      coding.name));
    }
  }
}

}  // namespace fovea::ingest
