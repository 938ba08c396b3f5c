#include <algorithm>
#include <functional>
#include <memory>
#include <string_view>
#include <utility>

#include <CLI/CLI.hpp>

#include "service/cli/commands.h"
#include "service/cli/console.h"
#include "service/cli/verbs.h"

namespace fovea::cli {

CLI::App* AddVerb(CLI::App* app, const char* name, const char* help, const char* examples) {
  CLI::App* verb = app->add_subcommand(name, help);
  verb->footer(std::string("Examples:\n") + examples);
  return verb;
}

void AddDataset(CLI::App* verb, std::string* dataset) {
  verb->add_option("dataset", *dataset, "The dataset's folder, NAME.zarr")
      ->required()
      ->type_name("DS.zarr");
}

namespace {

/// A verb on offer, and what makes its command of the line that was read.
struct Verb {
  CLI::App* app;
  std::function<ParseResult()> take;
};

template <typename T>
ParseResult Checked(const CLI::App& verb, T* command) {
  if constexpr (std::is_same_v<T, ServeCommand>) {
    command->arguments = verb.remaining();
  }
  const Status status = Check(command);
  if (!status.ok()) {
    return {std::nullopt,
            fmt::format("{}\nsee `fovea {} --help`", WithFlag(status), verb.get_name()), 2};
  }
  return {std::move(*command), "", 0};
}

template <typename T>
void Offer(CLI::App* (*add)(CLI::App*, T*), CLI::App* app, std::vector<Verb>* verbs) {
  const auto command = std::make_shared<T>();
  CLI::App* verb = add(app, command.get());
  verbs->push_back({verb, [=] { return Checked(*verb, command.get()); }});
}

/// What is wrong with the verb itself, for which CLI11 has no good words; empty if nothing is.
std::string VerbProblem(const CLI::App& app, const std::vector<std::string>& arguments) {
  if (!arguments.empty() && arguments[0].starts_with('-')) {
    return "";
  }
  std::string verbs;
  for (const CLI::App* verb : app.get_subcommands(nullptr)) {
    if (!arguments.empty() && verb->get_name() == arguments[0]) {
      return "";
    }
    verbs += (verbs.empty() ? "" : ", ") + verb->get_name();
  }
  const std::string what =
      arguments.empty() ? "a verb is missing" : fmt::format("there is no verb '{}'", arguments[0]);
  return fmt::format("{}; there are: {}", what, verbs);
}

/// What is wrong, in words that say which option it is about.
std::string ProblemOf(const CLI::ParseError& error) {
  constexpr std::string_view kCannot = "Could not convert: ";  // of CLI11: NAME = TEXT
  std::string text = error.what();
  const size_t equals = text.find(" = ");
  if (text.starts_with(kCannot) && equals != std::string::npos) {
    text =
        fmt::format("{}: '{}' is not a number that it takes",
                    text.substr(kCannot.size(), equals - kCannot.size()), text.substr(equals + 3));
  }
  return text;
}

const char* InstructionSet() {
#if defined(__x86_64__)
  return "x86-64 baseline";
#elif defined(__aarch64__)
  return "AArch64 baseline";
#else
  return "baseline";
#endif
}

}  // namespace

ParseResult ParseCommandLine(const std::vector<std::string>& arguments) {
  CLI::App app("Fovea renders volumes foveated: sharp where you look, cheap everywhere else.",
               "fovea");
  app.require_subcommand(1);
  app.set_version_flag("--version", fmt::format("fovea {} ({})", FOVEA_VERSION, InstructionSet()));
  app.footer(
      "Start here:\n"
      "  fovea demo\n"
      "  fovea export 'smoke.####.vdb' -o smoke.mp4\n"
      "`fovea VERB --help` explains each verb. Exit status: 0 done, 1 failed, 2 wrong usage.");
  std::vector<Verb> verbs;
  Offer(AddIngest, &app, &verbs);
  Offer(AddSensors, &app, &verbs);
  Offer(AddInfo, &app, &verbs);
  Offer(AddStats, &app, &verbs);
  Offer(AddVerify, &app, &verbs);
  Offer(AddRepair, &app, &verbs);
  Offer(AddMerge, &app, &verbs);
  Offer(AddRetain, &app, &verbs);
  Offer(AddExtract, &app, &verbs);
  Offer(AddPlan, &app, &verbs);
  Offer(AddRender, &app, &verbs);
  Offer(AddExpand, &app, &verbs);
  Offer(AddExport, &app, &verbs);
  Offer(AddBench, &app, &verbs);
  Offer(AddServe, &app, &verbs);
  Offer(AddJobs, &app, &verbs);
  Offer(AddToken, &app, &verbs);
  Offer(AddDelete, &app, &verbs);
  Offer(AddDoctor, &app, &verbs);
  Offer(AddDemo, &app, &verbs);
  if (const std::string problem = VerbProblem(app, arguments); !problem.empty()) {
    return {std::nullopt, problem + "\nsee `fovea --help`", 2};
  }
  try {
    app.parse(std::vector<std::string>(arguments.rbegin(), arguments.rend()));
  } catch (const CLI::CallForHelp&) {
    return {std::nullopt, app.help(), 0};
  } catch (const CLI::CallForVersion& version) {
    return {std::nullopt, version.what(), 0};
  } catch (const CLI::ParseError& error) {
    std::string verb;
    for (auto given = app.get_subcommands(); !given.empty();
         given = given.front()->get_subcommands()) {
      verb += " " + given.front()->get_name();
    }
    return {std::nullopt, fmt::format("{}\nsee `fovea{} --help`", ProblemOf(error), verb),
            error.get_exit_code() == 1 ? 1 : 2};
  }
  const auto is_given = [](const Verb& verb) { return verb.app->parsed(); };
  ParseResult result = std::find_if(verbs.begin(), verbs.end(), is_given)->take();
  if (auto* ingest = result.command ? std::get_if<IngestCommand>(&*result.command) : nullptr) {
    ingest->arguments = arguments;
  }
  return result;
}

}  // namespace fovea::cli
