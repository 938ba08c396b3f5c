#include <sys/stat.h>

#include <algorithm>
#include <filesystem>
#include <system_error>

#include "engine/base/parallel.h"
#include "service/export/frame_provider.h"
#include "service/frames/frames.h"

namespace fovea::exports {
namespace {

class LocalProvider final : public FrameProvider {
 public:
  LocalProvider(std::shared_ptr<store::Dataset> dataset, std::string identity,
                frames::FrameSpec defaults, int threads)
      : dataset_(std::move(dataset)),
        info_(dataset_->info()),
        identity_(std::move(identity)),
        name_(std::filesystem::path(dataset_->path()).stem().string()),
        defaults_(std::move(defaults)),
        threads_(threads) {}

  [[nodiscard]] const std::string& identity() const override { return identity_; }
  [[nodiscard]] const store::DatasetInfo& info() const override { return info_; }

  StatusOr<std::vector<StepInfo>> Describe(const std::vector<int64_t>& steps) override {
    std::vector<StepInfo> described;
    for (const int64_t step : steps) {
      FOVEA_ASSIGN_OR_RETURN(const int64_t time_ns, dataset_->TimeNs(step));
      FOVEA_ASSIGN_OR_RETURN(const auto number, dataset_->FrameNumber(step));
      described.push_back({step, time_ns, number});
    }
    return described;
  }

  StatusOr<frames::FrameSpec> Resolve(const frames::FrameSpec& spec) override {
    return frames::ResolveSpec(*dataset_, spec, defaults_);
  }

  StatusOr<frames::Frame> Render(int64_t step, const frames::FrameSpec& spec) override {
    FOVEA_ASSIGN_OR_RETURN(const frames::FrameSpec resolved, Resolve(spec));
    return frames::RenderFrame(*dataset_, name_, step, resolved, threads_);
  }

  Status RenderEach(const std::vector<int64_t>& steps, const frames::FrameSpec& spec,
                    const std::function<Status(const frames::Frame&)>& on_frame) override {
    FOVEA_ASSIGN_OR_RETURN(const frames::FrameSpec resolved, Resolve(spec));
    // A fused frame is one thread's work: each thread gets one of its own.
    const bool one_each = resolved.mode == frames::Mode::kFused;
    const size_t at_once =
        one_each ? static_cast<size_t>(threads_ > 0 ? threads_ : HardwareThreads()) : 1;
    for (size_t begin = 0; begin < steps.size(); begin += at_once) {
      const size_t end = std::min(begin + at_once, steps.size());
      std::vector<StatusOr<frames::Frame>> made(end - begin);
      ParallelFor(0, static_cast<int64_t>(made.size()), 1, threads_,
                  [&](int64_t first, int64_t last) {
                    for (auto i = static_cast<size_t>(first); i < static_cast<size_t>(last); ++i) {
                      made[i] = frames::RenderFrame(*dataset_, name_, steps[begin + i], resolved,
                                                    one_each ? 1 : threads_);
                    }
                  });
      for (size_t i = 0; i < made.size(); ++i) {
        FOVEA_RETURN_IF_ERROR(made[i].status());
        made[i]->index = begin + i;
        FOVEA_RETURN_IF_ERROR(on_frame(*made[i]));
      }
    }
    return absl::OkStatus();
  }

 private:
  std::shared_ptr<store::Dataset> dataset_;
  store::DatasetInfo info_;
  std::string identity_;
  std::string name_;
  frames::FrameSpec defaults_;
  int threads_;
};

}  // namespace

Status FrameProvider::RenderShot(const Shot& shot, int64_t begin, int64_t end,
                                 const std::function<Status(const frames::Frame&)>& on_frame) {
  while (begin < end) {
    const frames::FrameSpec spec = shot.animation.SpecAt(begin, shot.spec);
    std::vector<int64_t> steps;
    do {
      steps.push_back(shot.StepAt(begin++));
    } while (begin < end && shot.animation.SpecAt(begin, shot.spec) == spec);
    FOVEA_RETURN_IF_ERROR(RenderEach(steps, spec, on_frame));
  }
  return absl::OkStatus();
}

StatusOr<std::unique_ptr<FrameProvider>> OpenLocal(const std::string& path, int threads) {
  FOVEA_ASSIGN_OR_RETURN(auto dataset, store::Dataset::Open(path));
  FOVEA_ASSIGN_OR_RETURN(frames::FrameSpec defaults, frames::DefaultSpec(*dataset));
  std::error_code error;
  std::string identity = std::filesystem::weakly_canonical(path, error).string();
  // A dataset that was deleted and made again under its old name is another folder.
  if (struct stat folder{}; ::stat(path.c_str(), &folder) == 0) {
    identity += fmt::format("#{}", folder.st_ino);
  }
  return std::make_unique<LocalProvider>(std::move(dataset), std::move(identity),
                                         std::move(defaults), threads);
}

}  // namespace fovea::exports
