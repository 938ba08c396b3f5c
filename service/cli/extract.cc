#include <nlohmann/json.hpp>

#include "engine/fovea/reconstruct.h"
#include "engine/store/dataset.h"
#include "service/cli/commands.h"
#include "service/cli/console.h"
#include "service/export/npy.h"
#include "service/export/output_file.h"
#include "service/frames/frames.h"

namespace fovea::cli {
namespace {

/// Slices read at a time, a power of two up to 32: memory follows a slab, not the volume.
int64_t SlabSlices(const Int3& size) {
  constexpr int64_t kSlabBytes = int64_t{256} << 20;
  int64_t slices = 32;
  while (slices > 1 && slices * size.x * size.y * int64_t{sizeof(float)} > kSlabBytes) {
    slices /= 2;
  }
  return slices;
}

StatusOr<Box3> BoxOf(const ExtractCommand& command, const Int3& dims) {
  const Box3 whole = Box3::OfSize(dims);
  if (command.box && !whole.Contains(*command.box)) {
    return InvalidArgument("--box: reaches outside the volume: 0,0,0 to {},{},{} (not included)",
                           dims.x, dims.y, dims.z);
  }
  return command.box.value_or(whole);
}

/// What --fovea, --rate and --window ask for, the rest of it chosen; nothing if none was given.
StatusOr<std::optional<Fovea>> FoveaOf(const ExtractCommand& command, store::Dataset& dataset) {
  if (!command.fovea && !command.rate && !command.window) {
    return std::optional<Fovea>();
  }
  frames::FrameSpec spec;
  spec.field = command.field;
  spec.fovea = command.fovea;
  spec.rate = command.rate;
  spec.window = command.window;
  FOVEA_ASSIGN_OR_RETURN(const frames::FrameSpec defaults, frames::DefaultSpec(dataset));
  FOVEA_ASSIGN_OR_RETURN(spec, frames::ResolveSpec(dataset, spec, defaults));
  return std::optional<Fovea>(frames::FoveaOf(spec));
}

Status WriteVoxels(const ExtractCommand& command, CoefficientSource& source, const Box3& box,
                   const std::optional<RetainedSet>& retained) {
  FOVEA_ASSIGN_OR_RETURN(exports::OutputFile file, exports::OutputFile::Create(command.file));
  const Int3 size = box.Size();
  if (command.file.ends_with(".npy")) {
    FOVEA_RETURN_IF_ERROR(file.Write(exports::NpyHeader({size.z, size.y, size.x})));
  }
  const int64_t slices = SlabSlices(size);
  Progress progress(command.output, "extract", "slices");
  for (int64_t z = box.lo.z; z < box.hi.z;) {
    // Slabs start at multiples of their height, so that they share few chunks.
    const int64_t end = std::min(box.hi.z, (z / slices + 1) * slices);
    Box3 slab = box;
    slab.lo.z = z;
    slab.hi.z = end;
    FOVEA_ASSIGN_OR_RETURN(const Grid voxels,
                           ExtractVoxels(source, slab, retained ? &*retained : nullptr));
    FOVEA_RETURN_IF_ERROR(file.Write({reinterpret_cast<const char*>(voxels.values.data()),
                                      voxels.values.size() * sizeof(float)}));
    z = end;
    progress.Update(z - box.lo.z, size.z);
    if (Interrupted()) {
      return Cancelled("stopped; {} was not written", command.file);
    }
  }
  return file.Commit();
}

}  // namespace

Status Run(const ExtractCommand& command) {
  FOVEA_ASSIGN_OR_RETURN(const auto dataset, store::Dataset::Open(command.dataset));
  const store::DatasetInfo info = dataset->info();
  const std::string field = command.field.value_or(info.default_field);
  FOVEA_ASSIGN_OR_RETURN(const Box3 box, BoxOf(command, info.hierarchy.dims()));
  FOVEA_ASSIGN_OR_RETURN(
      const auto source,
      dataset->OpenStep(command.step, field,
                        command.strict ? store::OnDamage::kFail : store::OnDamage::kCount));
  FOVEA_ASSIGN_OR_RETURN(const std::optional<Fovea> fovea, FoveaOf(command, *dataset));
  std::optional<RetainedSet> retained;
  if (fovea) {
    FOVEA_ASSIGN_OR_RETURN(retained, RetainedSet::Make(info.hierarchy, *fovea));
  }
  FOVEA_RETURN_IF_ERROR(WriteVoxels(command, *source, box, retained));

  const Int3 size = box.Size();
  const store::ReadStats read = source->read_stats();
  if (read.chunks_damaged > 0) {
    Warn(
        fmt::format("{} damaged chunks of '{}' at step {} were left out: coarser values "
                    "stand there; `fovea verify` lists them",
                    read.chunks_damaged, field, command.step));
  }
  if (command.output.json) {
    nlohmann::json report = {{"output", command.file},
                             {"dataset", command.dataset},
                             {"step", command.step},
                             {"field", field},
                             {"type", "float32"},
                             {"box", {box.lo.x, box.lo.y, box.lo.z, box.hi.x, box.hi.y, box.hi.z}},
                             {"chunks_read", read.chunks_read},
                             {"chunks_total", read.chunks_total},
                             {"chunks_damaged", read.chunks_damaged},
                             {"bytes_read", read.bytes_read}};
    if (fovea) {
      report["fovea"] = {fovea->at.x, fovea->at.y, fovea->at.z};
      report["rate"] = {fovea->rate.x, fovea->rate.y, fovea->rate.z};
    }
    PrintJson(report);
    return absl::OkStatus();
  }
  PrintLine(fmt::format("{}: {} x {} x {} float32 of {} at step {}{}; {} read", command.file,
                        size.x, size.y, size.z, field, command.step, fovea ? ", foveated" : "",
                        HumanBytes(read.bytes_read)));
  if (fovea) {
    PrintLine(fmt::format("pinned by: --fovea {} --rate {} --window {}",
                          FormatPosition({fovea->at}), FormatRate(fovea->rate),
                          WindowName(fovea->window)));
  }
  return absl::OkStatus();
}

}  // namespace fovea::cli
