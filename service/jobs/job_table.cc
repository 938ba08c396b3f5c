#include "service/jobs/job_table.h"

#include <algorithm>
#include <utility>

#include <absl/strings/str_join.h>
#include <sqlite3.h>

namespace fovea::jobs {
namespace {

constexpr int kVersion = 2;
constexpr int kBusyMs = 5000;

constexpr char kSchema[] =
    "CREATE TABLE jobs(number INTEGER PRIMARY KEY AUTOINCREMENT, id TEXT NOT NULL UNIQUE,"
    " kind INTEGER NOT NULL, state INTEGER NOT NULL, owner TEXT NOT NULL, dataset TEXT NOT NULL,"
    " target TEXT NOT NULL, request BLOB NOT NULL, done INTEGER NOT NULL, total INTEGER NOT NULL,"
    " failed INTEGER NOT NULL, message TEXT NOT NULL, created_ms INTEGER NOT NULL,"
    " started_ms INTEGER, ended_ms INTEGER, warnings TEXT NOT NULL DEFAULT '');"
    "CREATE INDEX jobs_of_owner ON jobs(owner, number);"
    "CREATE INDEX jobs_unended ON jobs(number) WHERE state < 3;"
    "CREATE TABLE failures(job INTEGER NOT NULL REFERENCES jobs(number) ON DELETE CASCADE,"
    " number INTEGER NOT NULL, file TEXT NOT NULL, reason TEXT NOT NULL,"
    " PRIMARY KEY(job, number)) WITHOUT ROWID;"
    "PRAGMA user_version = 2;";

/// From version 1.
constexpr char kMigration[] =
    "ALTER TABLE jobs ADD COLUMN warnings TEXT NOT NULL DEFAULT '';"
    "PRAGMA user_version = 2;";

/// In the order of Statement::ReadJob.
#define FOVEA_JOB_COLUMNS                                                                      \
  "number, id, kind, state, owner, dataset, target, done, total, failed, message, created_ms," \
  " started_ms, ended_ms, warnings, "

/// Warnings are lines of one text.
std::string JoinLines(const std::vector<std::string>& lines) {
  return absl::StrJoin(lines, "\n");
}

std::vector<std::string> SplitLines(const std::string& text) {
  std::vector<std::string> lines;
  for (size_t at = 0; at < text.size();) {
    const size_t end = std::min(text.find('\n', at), text.size());
    lines.push_back(text.substr(at, end - at));
    at = end + 1;
  }
  return lines;
}

}  // namespace

/// A prepared statement and its parameters, which are bound in order.
class JobTable::Statement {
 public:
  Statement(sqlite3* database, const char* sql) {
    code_ = sqlite3_prepare_v2(database, sql, -1, &statement_, nullptr);
  }
  ~Statement() { sqlite3_finalize(statement_); }
  Statement(const Statement&) = delete;
  Statement& operator=(const Statement&) = delete;

  Statement& Bind(int64_t value) { return Keep(sqlite3_bind_int64(statement_, ++bound_, value)); }
  Statement& Bind(const std::optional<int64_t>& value) {
    return value ? Bind(*value) : Keep(sqlite3_bind_null(statement_, ++bound_));
  }
  Statement& Bind(const std::string& text) {  // must outlive the statement
    return Keep(sqlite3_bind_text64(statement_, ++bound_, text.data(), text.size(), SQLITE_STATIC,
                                    SQLITE_UTF8));
  }
  Statement& BindBytes(const std::string& bytes) {
    return Keep(
        sqlite3_bind_blob64(statement_, ++bound_, bytes.data(), bytes.size(), SQLITE_STATIC));
  }

  /// Whether there is a row; the result code is in `code`.
  bool Step() {
    if (code_ == SQLITE_OK) {
      code_ = sqlite3_step(statement_);
    }
    const bool row = code_ == SQLITE_ROW;
    code_ = row || code_ == SQLITE_DONE ? SQLITE_OK : code_;
    return row;
  }
  [[nodiscard]] int code() const { return code_; }

  int64_t Int(int column) { return sqlite3_column_int64(statement_, column); }
  std::optional<int64_t> OptionalInt(int column) {
    return sqlite3_column_type(statement_, column) == SQLITE_NULL ? std::nullopt
                                                                  : std::optional(Int(column));
  }
  std::string Text(int column) {
    const auto* bytes = static_cast<const char*>(sqlite3_column_blob(statement_, column));
    const int size = sqlite3_column_bytes(statement_, column);
    return bytes == nullptr ? "" : std::string(bytes, static_cast<size_t>(size));
  }
  Job ReadJob() {
    Job job;
    job.number = Int(0);
    job.id = Text(1);
    job.kind = static_cast<Kind>(Int(2));
    job.state = static_cast<State>(Int(3));
    job.owner = Text(4);
    job.dataset = Text(5);
    job.target = Text(6);
    job.progress = {Int(7), Int(8), Int(9)};
    job.message = Text(10);
    job.created_ms = Int(11);
    job.started_ms = OptionalInt(12);
    job.ended_ms = OptionalInt(13);
    job.warnings = SplitLines(Text(14));
    job.request = Text(15);
    return job;
  }

 private:
  Statement& Keep(int code) {
    code_ = code_ == SQLITE_OK ? code : code_;
    return *this;
  }

  sqlite3_stmt* statement_ = nullptr;
  int code_ = SQLITE_OK;
  int bound_ = 0;
};

StatusOr<std::unique_ptr<JobTable>> JobTable::Open(const std::string& path) {
  sqlite3* database = nullptr;
  const int code =
      sqlite3_open_v2(path.c_str(), &database,
                      SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_NOMUTEX, nullptr);
  auto table = std::unique_ptr<JobTable>(new JobTable(path, database));
  if (code != SQLITE_OK) {
    return table->Error(code);
  }
  sqlite3_extended_result_codes(database, 1);
  sqlite3_busy_timeout(database, kBusyMs);
  FOVEA_RETURN_IF_ERROR(table->Prepare());
  return table;
}

JobTable::~JobTable() {
  sqlite3_close(database_);
}

Status JobTable::Prepare() {
  FOVEA_RETURN_IF_ERROR(
      Execute("PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL; PRAGMA foreign_keys = ON;"
              "PRAGMA wal_autocheckpoint = 64;"));
  int64_t version = 0;
  int64_t tables = 0;
  for (const auto& [sql, value] : {std::pair{"PRAGMA user_version", &version},
                                   std::pair{"SELECT count(*) FROM sqlite_schema", &tables}}) {
    Statement statement(database_, sql);
    if (statement.Step()) {
      *value = statement.Int(0);
    }
    FOVEA_RETURN_IF_ERROR(Error(statement.code()));
  }
  const char* const making = version == 0 && tables == 0 ? kSchema
                             : version == 1              ? kMigration
                                                         : nullptr;
  if (making != nullptr) {
    FOVEA_RETURN_IF_ERROR(Execute("BEGIN IMMEDIATE"));
    Status status = Execute(making);
    return status.ok() ? Execute("COMMIT") : status;
  }
  if (version != kVersion) {
    return FailedPrecondition(
        "{} is no table of jobs that this version knows (its version is {}, not {}); give another "
        "folder with --state",
        path_, version, kVersion);
  }
  return absl::OkStatus();
}

Status JobTable::Execute(const char* sql) {
  return Error(sqlite3_exec(database_, sql, nullptr, nullptr, nullptr));
}

Status JobTable::Error(int code) const {
  const char* text = database_ == nullptr ? sqlite3_errstr(code) : sqlite3_errmsg(database_);
  switch (code & 0xFF) {
    case SQLITE_OK:
    case SQLITE_DONE:
    case SQLITE_ROW:
      return absl::OkStatus();
    case SQLITE_FULL:
      return ResourceExhausted("{}: the disk is full: make room on it", path_);
    case SQLITE_NOTADB:
    case SQLITE_CORRUPT:
      return FailedPrecondition(
          "{} is damaged or no table of jobs ({}); move it away: jobs that it held are lost, what "
          "they made is not",
          path_, text);
    default:
      return Unavailable("{}: {}", path_, text);
  }
}

Status JobTable::Insert(Job* job) {
  const std::lock_guard lock(mutex_);
  Statement statement(database_,
                      "INSERT INTO jobs(id, kind, state, owner, dataset, target, request, done,"
                      " total, failed, message, created_ms, started_ms, ended_ms)"
                      " VALUES(?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)");
  statement.Bind(job->id)
      .Bind(static_cast<int64_t>(job->kind))
      .Bind(static_cast<int64_t>(job->state))
      .Bind(job->owner)
      .Bind(job->dataset)
      .Bind(job->target)
      .BindBytes(job->request)
      .Bind(job->progress.done)
      .Bind(job->progress.total)
      .Bind(job->progress.failed)
      .Bind(job->message)
      .Bind(job->created_ms)
      .Bind(job->started_ms)
      .Bind(job->ended_ms)
      .Step();
  FOVEA_RETURN_IF_ERROR(Error(statement.code()));
  job->number = sqlite3_last_insert_rowid(database_);
  return absl::OkStatus();
}

StatusOr<std::vector<Job>> JobTable::ReadJobs(Statement* statement) {
  std::vector<Job> jobs;
  while (statement->Step()) {
    jobs.push_back(statement->ReadJob());
  }
  FOVEA_RETURN_IF_ERROR(Error(statement->code()));
  return jobs;
}

StatusOr<Job> JobTable::Get(const std::string& id) {
  const std::lock_guard lock(mutex_);
  Statement statement(database_, "SELECT " FOVEA_JOB_COLUMNS "request FROM jobs WHERE id = ?");
  statement.Bind(id);
  FOVEA_ASSIGN_OR_RETURN(std::vector<Job> jobs, ReadJobs(&statement));
  if (jobs.empty()) {
    return NotFound("there is no job '{}'", id);
  }
  Job job = std::move(jobs.front());
  Statement failures(database_, "SELECT file, reason FROM failures WHERE job = ? ORDER BY number");
  failures.Bind(job.number);
  while (failures.Step()) {
    job.failures.push_back({failures.Text(0), failures.Text(1)});
  }
  FOVEA_RETURN_IF_ERROR(Error(failures.code()));
  return job;
}

StatusOr<std::vector<Job>> JobTable::List(const std::string& owner, int64_t before, int64_t limit) {
  const std::lock_guard lock(mutex_);
  Statement statement(database_, "SELECT " FOVEA_JOB_COLUMNS
                                 "NULL FROM jobs WHERE owner = ? AND number < ?"
                                 " ORDER BY number DESC LIMIT ?");
  statement.Bind(owner).Bind(before).Bind(limit);
  return ReadJobs(&statement);
}

StatusOr<std::vector<Job>> JobTable::Unended() {
  const std::lock_guard lock(mutex_);
  Statement statement(
      database_, "SELECT " FOVEA_JOB_COLUMNS "request FROM jobs WHERE state < 3 ORDER BY number");
  return ReadJobs(&statement);
}

Status JobTable::Update(const Job& job, size_t first_failure) {
  const std::lock_guard lock(mutex_);
  FOVEA_RETURN_IF_ERROR(Execute("BEGIN IMMEDIATE"));
  Status status = Write(job, first_failure);
  if (status.ok()) {
    status = Execute("COMMIT");
  }
  if (!status.ok()) {
    static_cast<void>(Execute("ROLLBACK"));  // some errors have done so already
  }
  return status;
}

Status JobTable::Write(const Job& job, size_t first_failure) {
  const std::string warnings = JoinLines(job.warnings);
  Statement statement(database_,
                      "UPDATE jobs SET state = ?, done = ?, total = ?, failed = ?, message = ?,"
                      " started_ms = ?, ended_ms = ?, warnings = ? WHERE number = ?");
  statement.Bind(static_cast<int64_t>(job.state))
      .Bind(job.progress.done)
      .Bind(job.progress.total)
      .Bind(job.progress.failed)
      .Bind(job.message)
      .Bind(job.started_ms)
      .Bind(job.ended_ms)
      .Bind(warnings)
      .Bind(job.number)
      .Step();
  FOVEA_RETURN_IF_ERROR(Error(statement.code()));
  if (first_failure == 0) {
    Statement none(database_, "DELETE FROM failures WHERE job = ?");
    none.Bind(job.number).Step();
    FOVEA_RETURN_IF_ERROR(Error(none.code()));
  }
  for (size_t i = first_failure; i < job.failures.size(); ++i) {
    Statement failure(database_, "INSERT INTO failures VALUES(?, ?, ?, ?)");
    failure.Bind(job.number)
        .Bind(static_cast<int64_t>(i))
        .Bind(job.failures[i].file)
        .Bind(job.failures[i].reason)
        .Step();
    FOVEA_RETURN_IF_ERROR(Error(failure.code()));
  }
  return absl::OkStatus();
}

Status JobTable::Prune(int64_t keep) {
  const std::lock_guard lock(mutex_);
  Statement statement(database_,
                      "DELETE FROM jobs WHERE number IN (SELECT number FROM jobs WHERE state >= 3"
                      " ORDER BY number DESC LIMIT -1 OFFSET ?)");
  statement.Bind(keep).Step();
  return Error(statement.code());
}

}  // namespace fovea::jobs
