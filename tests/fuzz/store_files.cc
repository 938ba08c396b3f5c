// One file of a small store is anything: opening and reading it fails, or gives values. Checksums
// are put right again on demand, because no fuzzer guesses them.

#include <cstring>
#include <map>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "engine/store/codec.h"
#include "engine/store/dataset.h"
#include "tests/fuzz/input.h"
#include "tests/support/simulated_disk.h"
#include "tests/unit/engine/store/store_test_util.h"

namespace {

using namespace fovea;
using namespace fovea::store;
using fovea::testing::SimulatedDisk;
using Files = std::map<std::string, std::vector<std::byte>>;

constexpr char kPath[] = "a.zarr";

const Files& Store() {
  static const Files files = [] {
    SimulatedDisk disk;
    fuzz::Require(
        store::testing::MakeStore(kPath, store::testing::MakeInfo({20, 12, 9}, 8), 2, disk).ok());
    return disk.Files();
  }();
  return files;
}

void Put(const std::string& path, const std::vector<std::byte>& bytes, SimulatedDisk* disk) {
  for (size_t slash = path.find('/', 1); slash != std::string::npos;
       slash = path.find('/', slash + 1)) {
    (void)disk->MakeDirectory(path.substr(0, slash));
  }
  const int handle = disk->Open(path, FileSystem::Access::kCreate);
  fuzz::Require(handle >= 0);
  (void)disk->Write(handle, bytes);
  disk->Close(handle);
}

/// The checksum over the attributes of a group (docs/formats/store.md).
void MendJson(std::vector<std::byte>* bytes) {
  using nlohmann::json;
  json group = json::parse(reinterpret_cast<const char*>(bytes->data()),
                           reinterpret_cast<const char*>(bytes->data()) + bytes->size(), nullptr,
                           /*allow_exceptions=*/false);
  if (!group.is_object() || !group.contains("attributes") || !group["attributes"].is_object() ||
      !group["attributes"].contains("fovea") || !group["attributes"]["fovea"].is_object()) {
    return;
  }
  json& attributes = group["attributes"]["fovea"];
  attributes.erase("crc32c");
  const std::string text = attributes.dump(-1, ' ', false, json::error_handler_t::replace);
  attributes["crc32c"] = Crc32c(std::as_bytes(std::span(text)));
  const std::string whole = group.dump(-1, ' ', false, json::error_handler_t::replace);
  const auto* first = reinterpret_cast<const std::byte*>(whole.data());
  bytes->assign(first, first + whole.size());
}

void MendBytes(std::vector<std::byte>* bytes) {
  if (bytes->size() >= sizeof(uint32_t)) {
    bytes->resize(bytes->size() - sizeof(uint32_t));
    AppendCrc32c(*bytes);
  }
}

std::vector<std::byte> Changed(const std::string& path, std::vector<std::byte> bytes,
                               fuzz::Input* input) {
  const auto how = input->Number<uint8_t>();
  if ((how & 1) != 0) {
    const std::string rest = input->Rest();
    const auto* first = reinterpret_cast<const std::byte*>(rest.data());
    bytes.assign(first, first + rest.size());
  } else {
    while (!input->empty() && !bytes.empty()) {
      const size_t at = input->Number<uint16_t>() % bytes.size();
      bytes[at] = static_cast<std::byte>(input->Number<uint8_t>());
    }
  }
  if ((how & 2) != 0) {
    path.ends_with("zarr.json") ? MendJson(&bytes) : MendBytes(&bytes);
  }
  return bytes;
}

void ReadAll(SimulatedDisk* disk) {
  constexpr int64_t kMostVoxels = 1 << 16;
  const auto dataset = Dataset::Open(kPath, *disk);
  if (!dataset.ok() || (*dataset)->info().hierarchy.dims().Max() > 64 ||
      (*dataset)->info().hierarchy.dims().Product() > kMostVoxels) {
    return;
  }
  const DatasetInfo info = (*dataset)->info();
  for (int64_t step = 0; step < std::min<int64_t>(info.committed_steps, 3); ++step) {
    (void)(*dataset)->TimeNs(step).ok();
    (void)(*dataset)->FrameNumber(step).ok();
    for (const FieldInfo& field : info.fields) {
      (void)(*dataset)->Stats(step, field.name).ok();
      for (const OnDamage on_damage : {OnDamage::kFail, OnDamage::kCount}) {
        const auto source = (*dataset)->OpenStep(step, field.name, on_damage);
        if (source.ok()) {
          (void)store::testing::ReadEverything(source->get()).ok();
        }
      }
    }
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  fuzz::Input input(data, size);
  const Files& store = Store();
  const size_t chosen = input.Number<uint8_t>() % store.size();
  SimulatedDisk disk;
  size_t index = 0;
  for (const auto& [path, bytes] : store) {
    Put(path, index++ == chosen ? Changed(path, bytes, &input) : bytes, &disk);
  }
  ReadAll(&disk);
  return 0;
}
