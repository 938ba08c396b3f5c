#include <algorithm>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "service/cli/commands.h"
#include "service/cli/console.h"
#include "service/cli/doctor_checks.h"
#include "service/cli/flags.h"
#include "service/cli/verbs.h"

namespace fovea::cli {
namespace {

std::string Name(Verdict verdict) {
  switch (verdict) {
    case Verdict::kGood:
      return "good";
    case Verdict::kLacking:
      return "lacking";
    case Verdict::kMissing:
      return "missing";
  }
  return "";
}

void Print(const std::vector<Finding>& findings) {
  size_t width = 0;
  for (const Finding& finding : findings) {
    width = std::max(width, finding.about.size());
  }
  for (const Finding& finding : findings) {
    const char* mark = finding.verdict == Verdict::kGood      ? "  "
                       : finding.verdict == Verdict::kLacking ? "- "
                                                              : "! ";
    PrintLine(fmt::format("{}{:<{}}  {}", mark, finding.about, width, finding.found));
    if (!finding.advice.empty()) {
      PrintLine(fmt::format("  {:<{}}  -> {}", "", width, finding.advice));
    }
  }
}

}  // namespace

CLI::App* AddDoctor(CLI::App* app, DoctorCommand* command) {
  CLI::App* verb = AddVerb(app, "doctor", "What this machine has, what it lacks, and what to do",
                           "  fovea doctor\n"
                           "  fovea doctor /srv/volumes --json\n"
                           "Ends with 1 only if something that is needed is missing.");
  verb->add_option("folder", command->folder,
                   "Where stores are to be kept: its file system is tried out (default: the "
                   "current folder)")
      ->type_name("DIR");
  AddOutputFlags(verb, &command->output);
  return verb;
}

Status Run(const DoctorCommand& command) {
  std::vector<Finding> findings = CheckMachine();
  for (Finding& finding : CheckPrograms()) {
    findings.push_back(std::move(finding));
  }
  for (Finding& finding :
       CheckFolder(command.folder.value_or("."), /*must_be_writable=*/command.folder.has_value())) {
    findings.push_back(std::move(finding));
  }
  const auto count = [&](Verdict verdict) {
    return std::count_if(findings.begin(), findings.end(),
                         [verdict](const Finding& f) { return f.verdict == verdict; });
  };
  const auto missing = count(Verdict::kMissing);
  const auto lacking = count(Verdict::kLacking);
  if (command.output.json) {
    nlohmann::json list = nlohmann::json::array();
    for (const Finding& finding : findings) {
      list.push_back({{"about", finding.about},
                      {"found", finding.found},
                      {"verdict", Name(finding.verdict)},
                      {"advice", finding.advice}});
    }
    PrintJson({{"findings", list}, {"missing", missing}, {"lacking", lacking}});
  } else {
    Print(findings);
    PrintLine(missing > 0   ? "something that is needed is missing (!)"
              : lacking > 0 ? "all that is needed is there; what is marked - could be better"
                            : "all is well");
  }
  if (missing > 0) {
    return FailedPrecondition("{} of the things that are needed are missing", missing);
  }
  return absl::OkStatus();
}

}  // namespace fovea::cli
