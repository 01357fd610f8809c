// MapLibre wants a worker before it has anything to decode. Without tiles there is nothing: this one does just that,
// and saves the page the loading of the real one.
