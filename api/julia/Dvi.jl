"""
Differential variational inequalities, solved by a service. One file; needs the packages HTTP and JSON3.

    include("Dvi.jl")
    spec = Dict("problem" => Dict("dvi" => Dict("states" => Dict("x" => Dict("initial" => 1, "rate" => "-x")))),
                "time" => Dict("end" => 1))
    r = Dvi.solve(spec)
    r.t, r["x"], r.verdict.trusted
"""
module Dvi

import HTTP, JSON3

"An answer: `t`, `r[\"x\"]`, `events`, `verdict`, `diagnostics`."
struct Result
    t::Vector{Float64}
    fields::Dict{String,Vector{Float64}}
    document::JSON3.Object
end

Base.getindex(r::Result, name::AbstractString) = r.fields[name]
Base.keys(r::Result) = keys(r.fields)

function Base.getproperty(r::Result, name::Symbol)
    name in fieldnames(Result) && return getfield(r, name)
    document = getfield(r, :document)
    return name == :events ? document.trajectory.events : getproperty(document, name)
end

"What a service refused, with each error of the specification at its place."
struct Refused <: Exception
    status::Int
    problem::Any
end

function Base.showerror(io::IO, refused::Refused)
    print(io, refused.status, ": ", get(refused.problem, :detail, get(refused.problem, :title, "")))
    for error in get(refused.problem, :errors, [])
        print(io, "\n  ", error.pointer, ": ", error.detail)
        haskey(error, :did_you_mean) && print(io, "; did you mean ", error.did_you_mean, "?")
    end
end

"Has the service at `url` solve `specification`, a dictionary or JSON text."
function solve(specification; url="http://localhost:8080", token=nothing)
    text = specification isa AbstractString ? specification : JSON3.write(specification)
    headers = ["Content-Type" => "application/json", "Accept" => "application/json", "Prefer" => "wait=60"]
    token === nothing || push!(headers, "Authorization" => "Bearer $token")
    answer = HTTP.post("$url/solve", headers, text; status_exception=false)
    while answer.status == 202
        # The solve takes longer than the wait: the job is polled until it has ended.
        job = JSON3.read(answer.body).id
        sleep(0.5)
        state = HTTP.get("$url/jobs/$job", headers; status_exception=false)
        state.status == 200 || (answer = state; break)
        JSON3.read(state.body).status in ("accepted", "running") && continue
        answer = HTTP.get("$url/jobs/$job/results", headers; status_exception=false)
    end
    document = JSON3.read(answer.body)
    answer.status == 200 || throw(Refused(answer.status, document))
    document.verdict.trusted || @warn "the answer is not trusted" document.verdict.because
    fields = Dict(String(name) => Vector{Float64}(values) for (name, values) in document.trajectory.fields)
    return Result(Vector{Float64}(document.trajectory.t), fields, document)
end

end
