// Writes a store, and what the engine reads from it, for check.mjs to compare with:
// zarrita_dump FOLDER makes FOLDER/a.zarr, expected.json and a .bin file for every window.

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <span>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "engine/store/dataset.h"
#include "engine/store/dataset_writer.h"
#include "tests/unit/engine/store/store_test_util.h"

namespace fovea::store {
namespace {

using nlohmann::json;

constexpr int64_t kSteps = 3;

Status WriteValues(const std::string& path, std::span<const float> values) {
  std::ofstream file(path, std::ios::binary);
  const auto bytes = std::as_bytes(values);
  file.write(reinterpret_cast<const char*>(bytes.data()), std::ssize(bytes));
  return file.good() ? absl::OkStatus() : Internal("cannot write {}", path);
}

/// The values of `window` of one level, as the engine reads them.
StatusOr<json> DumpDetail(const std::string& folder, StepSource* source, const std::string& field,
                          int64_t step, int level, const Box3& window) {
  std::vector<float> values(static_cast<size_t>(7 * window.Volume()));
  FOVEA_RETURN_IF_ERROR(source->ReadDetail(level, window, values));
  const int64_t width = source->hierarchy().WidthAt(level);
  const std::string file = fmt::format("{}_{}_{}.bin", field, step, width);
  FOVEA_RETURN_IF_ERROR(WriteValues(folder + "/" + file, values));
  const Int3 dims = source->hierarchy().DimsAt(level);
  return json{{"array", fmt::format("{}/detail_{}", field, width)},
              {"shape", {kSteps, 7, dims.z, dims.y, dims.x}},
              {"step", step},
              {"window",
               {{0, 7},
                {window.lo.z, window.hi.z},
                {window.lo.y, window.hi.y},
                {window.lo.x, window.hi.x}}},
              {"values", file}};
}

StatusOr<json> DumpCoarse(const std::string& folder, StepSource* source, const std::string& field,
                          int64_t step) {
  const Int3 dims = source->hierarchy().DimsAt(0);
  std::vector<float> values(static_cast<size_t>(dims.Product()));
  FOVEA_RETURN_IF_ERROR(source->ReadCoarse(values));
  const std::string file = fmt::format("{}_{}_coarse.bin", field, step);
  FOVEA_RETURN_IF_ERROR(WriteValues(folder + "/" + file, values));
  return json{{"array", field + "/coarse"},
              {"shape", {kSteps, dims.z, dims.y, dims.x}},
              {"step", step},
              {"window", {{0, dims.z}, {0, dims.y}, {0, dims.x}}},
              {"values", file}};
}

Status DumpField(const std::string& folder, Dataset* dataset, const std::string& field,
                 json* windows) {
  for (int64_t step = 0; step < kSteps; ++step) {
    FOVEA_ASSIGN_OR_RETURN(const auto source, dataset->OpenStep(step, field, OnDamage::kFail));
    FOVEA_ASSIGN_OR_RETURN(json coarse, DumpCoarse(folder, source.get(), field, step));
    windows->push_back(std::move(coarse));
    for (int level = 0; level < source->hierarchy().finest(); ++level) {
      const Int3 size = source->hierarchy().DimsAt(level);
      // From whole at step 0 to a few coefficients that lie across chunks, and across shards.
      const Box3 window{{step * size.x / 5, step * size.y / 6, step * size.z / 5},
                        {size.x - step, size.y - step, size.z - step * size.z / 4}};
      FOVEA_ASSIGN_OR_RETURN(json detail,
                             DumpDetail(folder, source.get(), field, step, level, window));
      windows->push_back(std::move(detail));
    }
  }
  return absl::OkStatus();
}

StatusOr<json> DumpSteps(Dataset* dataset, const std::string& field) {
  json steps = json::array();
  for (int64_t step = 0; step < kSteps; ++step) {
    FOVEA_ASSIGN_OR_RETURN(const int64_t time_ns, dataset->TimeNs(step));
    FOVEA_ASSIGN_OR_RETURN(const auto frame_number, dataset->FrameNumber(step));
    FOVEA_ASSIGN_OR_RETURN(const FieldStats stats, dataset->Stats(step, field));
    steps.push_back({{"time_ns", std::to_string(time_ns)},
                     {"frame_number", frame_number ? json(*frame_number) : json()},
                     {"minimum", stats.minimum},
                     {"maximum", stats.maximum},
                     {"histogram", stats.histogram}});
  }
  return steps;
}

Status Dump(const std::string& folder) {
  std::filesystem::create_directories(folder);
  const std::string path = folder + "/a.zarr";
  std::filesystem::remove_all(path);
  // Odd sizes; detail_2 has 75 x 21 x 19 coefficients: 10 x 3 x 3 chunks in two shards.
  const Int3 dims{150, 41, 37};
  DatasetInfo info = testing::MakeInfo(dims, 8, {"density", "heat"});
  info.fields[1].type = "int16";
  FOVEA_RETURN_IF_ERROR(testing::MakeStore(path, info, kSteps));
  FOVEA_ASSIGN_OR_RETURN(const auto dataset, Dataset::Open(path));
  json windows = json::array();
  for (const char* field : {"density", "heat"}) {
    FOVEA_RETURN_IF_ERROR(DumpField(folder, dataset.get(), field, &windows));
  }
  FOVEA_ASSIGN_OR_RETURN(json steps, DumpSteps(dataset.get(), "density"));
  const json expected = {{"dims_xyz", {dims.x, dims.y, dims.z}},
                         {"steps", std::move(steps)},
                         {"windows", std::move(windows)}};
  std::ofstream file(folder + "/expected.json");
  file << expected.dump(1) << "\n";
  return file.good() ? absl::OkStatus() : Internal("cannot write expected.json");
}

}  // namespace
}  // namespace fovea::store

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: zarrita_dump FOLDER\n");
    return 2;
  }
  const fovea::Status status = fovea::store::Dump(argv[1]);
  if (!status.ok()) {
    std::fprintf(stderr, "%s\n", std::string(fovea::MessageOf(status)).c_str());
    return 1;
  }
  return 0;
}
