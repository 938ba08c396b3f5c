#include "ingest/parts.h"

#include <algorithm>
#include <filesystem>
#include <span>
#include <utility>

#include <absl/strings/escaping.h>
#include <nlohmann/json.hpp>

#include "engine/store/codec.h"
#include "engine/store/file.h"
#include "engine/store/merge.h"
#include "ingest/protocol.h"

namespace fovea::ingest {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr int kPlanVersion = 1;
constexpr int64_t kMaxPlanBytes = int64_t{1} << 30;
constexpr const char* kVersionKey = "fovea_plan";
constexpr const char* kChecksumKey = "crc32c";

std::string ToText(const Frame& frame) {
  return absl::Base64Escape(frame.payload);
}

StatusOr<Frame> ToFrame(FrameKind kind, const json& text) {
  Frame frame{kind, ""};
  const auto& encoded = text.get_ref<const std::string&>();
  if (!absl::Base64Unescape(absl::string_view(encoded.data(), encoded.size()), &frame.payload)) {
    return DataLoss("what was found in a file is not base64");
  }
  return frame;
}

std::string Absolute(const std::string& path) {
  std::error_code error;
  const fs::path absolute = fs::absolute(path, error);
  return error ? path : absolute.lexically_normal().string();
}

json ToJson(const ScannedFile& scanned) {
  json grids = json::array();
  for (const GridInfo& grid : scanned.grids) {
    grids.push_back(ToText(Encode(grid)));
  }
  json file = {{"path", Absolute(scanned.file.path)},
               {"held", scanned.file.held},
               {"further", json::array()},
               {"info", ToText(Encode(scanned.info))},
               {"grids", std::move(grids)}};
  if (scanned.file.frame_number) {
    file["frame_number"] = *scanned.file.frame_number;
  }
  for (const std::string& path : scanned.file.further) {
    file["further"].push_back(Absolute(path));
  }
  return file;
}

StatusOr<ScannedFile> FromJson(const json& file) {
  ScannedFile scanned;
  scanned.file.path = file.at("path").get<std::string>();
  scanned.file.held = file.at("held").get<bool>();
  scanned.file.further = file.at("further").get<std::vector<std::string>>();
  if (file.contains("frame_number")) {
    scanned.file.frame_number = file.at("frame_number").get<int64_t>();
  }
  FOVEA_ASSIGN_OR_RETURN(const Frame info, ToFrame(FrameKind::kFile, file.at("info")));
  FOVEA_ASSIGN_OR_RETURN(scanned.info, DecodeFileInfo(info));
  for (const json& text : file.at("grids")) {
    FOVEA_ASSIGN_OR_RETURN(const Frame frame, ToFrame(FrameKind::kGrid, text));
    FOVEA_ASSIGN_OR_RETURN(GridInfo grid, DecodeGridInfo(frame));
    scanned.grids.push_back(std::move(grid));
  }
  return scanned;
}

uint32_t ChecksumOf(const json& plan) {
  const std::string text = plan.dump();
  return store::Crc32c(std::as_bytes(std::span(text)));
}

/// What is for people, beside what ReadPlan reads.
json PlanJson(const PlannedSeries& planned, const std::vector<std::string>& arguments) {
  const Box3& extent = planned.plan.extent;
  json files = json::array();
  for (const ScannedFile& file : planned.scanned) {
    files.push_back(ToJson(file));
  }
  json plan = {
      {kVersionKey, kPlanVersion},
      {"arguments", arguments},
      {"series", planned.series},
      {"steps", planned.plan.steps.size()},
      {"fields", planned.plan.fields},
      {"extent", {extent.lo.x, extent.lo.y, extent.lo.z, extent.hi.x, extent.hi.y, extent.hi.z}},
      {"files", std::move(files)}};
  plan[kChecksumKey] = fmt::format("{:08x}", ChecksumOf(plan));
  return plan;
}

StatusOr<PlanFile> PlanFrom(json document, const std::string& path) {
  if (!document.is_object() || !document.contains(kVersionKey)) {
    return FailedPrecondition("{} is no plan of an ingest (--plan makes one)", path);
  }
  if (document.at(kVersionKey) != kPlanVersion) {
    return FailedPrecondition("{} was made by another version of fovea: plan again", path);
  }
  const auto stored = document.at(kChecksumKey).get<std::string>();
  document.erase(kChecksumKey);
  if (stored != fmt::format("{:08x}", ChecksumOf(document))) {
    return DataLoss("{} is damaged or was edited: plan again", path);
  }
  PlanFile plan;
  plan.arguments = document.at("arguments").get<std::vector<std::string>>();
  plan.series = document.at("series").get<std::string>();
  plan.steps = document.at("steps").get<int64_t>();
  for (const json& file : document.at("files")) {
    FOVEA_ASSIGN_OR_RETURN(ScannedFile scanned, FromJson(file));
    plan.scanned.push_back(std::move(scanned));
  }
  if (plan.scanned.empty()) {
    return DataLoss("{} is damaged: it has no files", path);
  }
  return plan;
}

}  // namespace

StatusOr<PlannedSeries> WritePlan(const IngestOptions& options,
                                  const std::vector<std::string>& arguments,
                                  const std::string& path,
                                  const std::function<bool(const IngestProgress&)>& progress) {
  FOVEA_ASSIGN_OR_RETURN(PlannedSeries planned, PlanIngest(options, progress));
  std::string text;
  try {
    text = PlanJson(planned, arguments).dump(1) + "\n";
  } catch (const json::exception& error) {  // a file name that is not UTF-8
    return InvalidArgument("the plan cannot be written as JSON: {}", error.what());
  }
  store::FileBatch batch(store::RealFileSystem());
  FOVEA_RETURN_IF_ERROR(batch.Write(path, std::as_bytes(std::span(text))));
  FOVEA_RETURN_IF_ERROR(batch.Flush());
  FOVEA_RETURN_IF_ERROR(batch.Publish());
  return planned;
}

StatusOr<PlanFile> ReadPlan(const std::string& path) {
  FOVEA_ASSIGN_OR_RETURN(const std::vector<std::byte> bytes,
                         store::ReadWholeFile(store::RealFileSystem(), path, kMaxPlanBytes));
  try {
    const auto* text = reinterpret_cast<const char*>(bytes.data());
    return PlanFrom(json::parse(text, text + bytes.size()), path);
  } catch (const std::exception& error) {
    return DataLoss("{} is damaged: {}", path, error.what());
  }
}

StatusOr<IngestReport> IngestPart(const IngestOptions& options, const PlanFile& plan, int64_t part,
                                  int64_t parts,
                                  const std::function<bool(const IngestProgress&)>& progress) {
  if (options.output.empty()) {
    return InvalidArgument("no dataset to write was named");
  }
  if (parts > 1 && options.tolerance) {
    return InvalidArgument(
        "--tolerance: each part would choose scales by its own first step: make it in one piece, "
        "without --shard");
  }
  IngestOptions of_part = options;
  if (parts > 1) {
    of_part.output = store::PartPath(options.output, part, parts);
  }
  Given given;
  given.scanned = plan.scanned;
  given.part = part;
  given.parts = parts;
  return IngestGiven(of_part, given, progress);
}

}  // namespace fovea::ingest
