//! Export of the spans of requests and jobs to an OpenTelemetry collector, in programs built with the feature `otlp`,
//! if `OTEL_EXPORTER_OTLP_ENDPOINT` names one. Otherwise no spans are recorded.

#[cfg(feature = "otlp")]
pub use exported::Spans;
#[cfg(not(feature = "otlp"))]
pub use none::Spans;

#[cfg(feature = "otlp")]
mod exported {
    use opentelemetry::trace::TracerProvider;
    use opentelemetry_otlp::{Protocol, SpanExporter, WithExportConfig};
    use opentelemetry_sdk::Resource;
    use opentelemetry_sdk::trace::SdkTracerProvider;
    use std::env;
    use std::time::Duration;
    use tracing::Subscriber;
    use tracing_subscriber::Layer;
    use tracing_subscriber::filter::filter_fn;
    use tracing_subscriber::registry::LookupSpan;

    /// The environment variables that name the OpenTelemetry collector of trace spans.
    const ENDPOINTS: [&str; 2] = ["OTEL_EXPORTER_OTLP_ENDPOINT", "OTEL_EXPORTER_OTLP_TRACES_ENDPOINT"];

    /// The time limit for exporting the last trace spans when the program ends.
    const LAST_SPANS: Duration = Duration::from_secs(3);

    /// The exporter of trace spans, if an OpenTelemetry collector is configured.
    pub struct Spans(Option<SdkTracerProvider>);

    impl Spans {
        /// Starts the exporting thread, if a collector is configured.
        ///
        /// # Errors
        /// The environment variables name no valid address.
        pub fn start() -> Result<Self, Box<dyn std::error::Error>> {
            if ENDPOINTS.iter().all(|name| env::var_os(name).is_none_or(|endpoint| endpoint.is_empty())) {
                return Ok(Self(None));
            }
            let exporter = SpanExporter::builder().with_http().with_protocol(Protocol::HttpBinary).build()?;
            let name = env::var("OTEL_SERVICE_NAME").unwrap_or_else(|_| "dvi".to_owned());
            let resource = Resource::builder().with_service_name(name).build();
            Ok(Self(Some(SdkTracerProvider::builder().with_resource(resource).with_batch_exporter(exporter).build())))
        }

        /// The tracing layer that exports the spans of the service, but none of the libraries that it uses.
        pub fn layer<S>(&self) -> Option<impl Layer<S> + use<S>>
        where
            S: Subscriber + for<'a> LookupSpan<'a>,
        {
            let layer = tracing_opentelemetry::layer().with_tracer(self.0.as_ref()?.tracer("dvi"));
            Some(layer.with_filter(filter_fn(|of| of.is_span() && of.target().starts_with("service"))))
        }

        /// Exports the trace spans that have not been exported yet, before the program ends.
        pub fn end(self) {
            if let Some(Err(error)) = self.0.map(|provider| provider.shutdown_with_timeout(LAST_SPANS)) {
                tracing::warn!(%error, "the last spans did not reach the collector");
            }
        }
    }
}

#[cfg(not(feature = "otlp"))]
mod none {
    use std::convert::Infallible;
    use tracing::Subscriber;
    use tracing_subscriber::Layer;
    use tracing_subscriber::layer::Identity;

    /// Stand-in for the exporter of trace spans in a program built without the feature `otlp`.
    pub struct Spans;

    impl Spans {
        /// Returns a stand-in for the exporter, which exports no trace spans.
        pub fn start() -> Result<Self, Infallible> {
            Ok(Self)
        }

        /// Returns no tracing layer: a layer without a filter, even one that does nothing, would have every span
        /// recorded.
        pub fn layer<S: Subscriber>(&self) -> Option<impl Layer<S> + use<S>> {
            None::<Identity>
        }

        /// Does nothing, since no trace spans are recorded.
        pub fn end(self) {}
    }
}
