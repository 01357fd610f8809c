// An empty worker. MapLibre starts a worker even without tiles or layers to decode; the page then loads this file instead
// of MapLibre's large worker.
